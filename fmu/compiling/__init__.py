"""Compilers for this and other platforms, and the cache of what they built."""
