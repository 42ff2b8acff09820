"""The controller's compiled step as a library that needs no Python: object code, a C interface, and how it is built."""
