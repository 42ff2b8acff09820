"""What a solver says of its answer, as a number in records and as a word in plans."""

UNASKED, UNCONSTRAINED, SOLVED, ITERATION_LIMIT, INFEASIBLE, NUMERICS, INPUT = range(7)
NAMES = ("", "UNCONSTRAINED", "SOLVED", "ITERATION_LIMIT", "INFEASIBLE", "NUMERICS", "INPUT")
"""Words by number: "UNCONSTRAINED" if no bound acts, "INPUT" if the state kept the solver from being asked."""
