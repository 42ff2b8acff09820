"""What the controller makes of its measurements."""
