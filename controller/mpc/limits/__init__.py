"""Limits of (16), one a file: each fills its lines and returns the next free one."""
