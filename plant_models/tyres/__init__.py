"""Tyre forces: the Magic Formula, its parameters and property files, and tyres that stand on contacts."""
