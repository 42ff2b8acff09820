"""A scenario over ranges of its keys."""
