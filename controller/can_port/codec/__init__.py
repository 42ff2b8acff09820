"""Messages and signals: the database, their coding, exports and other makers' formats."""
