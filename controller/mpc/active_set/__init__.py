"""The exact QP solver of the core: a dense dual active set, compiled, that allocates nothing."""

from sidestep.controller.mpc.active_set.iteration import EXHAUSTED, INFEASIBLE, INVALID, SOLVED, solve
from sidestep.controller.mpc.active_set.problem import Problem, Result, Work, result_space, work_space

__all__ = [
    "EXHAUSTED", "INFEASIBLE", "INVALID", "SOLVED", "Problem", "Result", "Work", "result_space", "solve", "work_space",
]  # fmt: skip
