"""A car's parameters from its drives."""
