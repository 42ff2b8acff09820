"""Whether a plant keeps to the conventions of the seams."""
