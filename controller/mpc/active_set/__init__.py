"""The exact QP solver of the core: a dense dual active set, compiled, that allocates nothing."""
