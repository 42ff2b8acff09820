"""Measured logs of real cars: files, names, units, rates, gaps."""
