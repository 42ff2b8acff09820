"""What a drive is worth, by code that shares nothing with the controller."""
