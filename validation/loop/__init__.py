"""Controller and plant in one loop, and the record of it."""
