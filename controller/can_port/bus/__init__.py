"""Frames on a bus: buses, logs, channels, pacing and faults."""
