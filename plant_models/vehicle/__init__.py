"""What a car is: its parameters, the files they come from, and presets."""
