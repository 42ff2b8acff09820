"""What can be said of an FMU: by its files, by other checkers, and by driving it."""
