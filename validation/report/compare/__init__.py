"""Runs beside each other, and against golden recordings."""
