"""Cost terms of (15), one a file: each fills its residual at a node, and the stack adds its square."""
