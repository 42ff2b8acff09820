"""Where to drive: the lattice search, the corridor, and how fast the way allows."""
