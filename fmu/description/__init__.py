"""What an FMU says of itself: variables, model description, icon, documentation, expected output."""
