"""Other people's FMUs: reading, loading, mapping, checking and driving them."""
