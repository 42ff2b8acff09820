"""What the scripts of a page are given: figures and scenes as numbers."""
