"""Readers of scenario formats that others define."""
