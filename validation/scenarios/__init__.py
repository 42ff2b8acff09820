"""What is to be driven: scenario files, tables and random scenes."""
