"""FMUs of the controller, their descriptions, and systems of several."""
