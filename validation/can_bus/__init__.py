"""Drives over a CAN bus, its monitor, replays and faults."""
