"""How the command line is typed: errors, examples, completion."""
