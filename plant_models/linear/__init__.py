"""The paper's linear bicycle, and a plant made of it."""
