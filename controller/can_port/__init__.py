"""Steering commands as protected CAN frames."""
