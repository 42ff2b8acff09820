"""The stacked QP in PIQP, which Python asks where a bound acts."""

from dataclasses import dataclass

import numpy as np
import piqp
from numpy.typing import NDArray

from sidestep.controller.mpc.rows import NEAREST, RESERVE, add_violated, fill_cost, fill_rows
from sidestep.controller.mpc.status import INFEASIBLE, ITERATION_LIMIT, NUMERICS, SOLVED
from sidestep.controller.records import SLACKS

Array = NDArray[np.float64]

EPS = 1e-9
"""Absolute accuracy asked of PIQP, its duality gap included: 1e-8 leaves errors above 1e-5 rad/s in the first move."""
STEP_SHARE = 0.999
"""Share of the way to the nearest bound that PIQP goes in an iteration: its own 0.99 costs one iteration of seven."""
MAX_ITERATIONS = 60
"""Ten times what a step takes; beyond, the solver is stuck."""
TOLERANCE = 1e-6
"""Violation of a bound without a row that is let pass, in [m] or [rad]."""
STATUS = {
    piqp.PIQP_SOLVED: SOLVED, piqp.PIQP_MAX_ITER_REACHED: ITERATION_LIMIT, piqp.PIQP_PRIMAL_INFEASIBLE: INFEASIBLE,
}  # fmt: skip
"""PIQP's status; any other is a matter of NUMERICS."""


@dataclass(frozen=True)
class Problem:
    """min 1/2 z'Pz + c'z with h_l <= G z <= h_u and x_l <= z <= x_u."""

    P: Array
    c: Array
    G: Array
    h_l: Array
    h_u: Array
    x_l: Array
    x_u: Array


def set_up(p: Problem, preconditioner_rounds: int = 0) -> piqp.DenseSolver:
    """A PIQP solver for a problem, set as the controller sets it."""
    solver = piqp.DenseSolver()
    settings = solver.settings
    settings.eps_abs, settings.eps_rel, settings.max_iter = EPS, 0.1 * EPS, MAX_ITERATIONS
    settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = 0.1 * EPS, 0.1 * EPS
    settings.preconditioner_iter, settings.tau = preconditioner_rounds, STEP_SHARE
    solver.setup(p.P, p.c, None, None, p.G, p.h_l, p.h_u, p.x_l, p.x_u)
    return solver


class _Rows:
    """One QP in memory and the solver that knows its size."""

    def __init__(self, moves: int, rows: int, rate: float):
        size = moves + SLACKS
        self.problem = p = Problem(
            P=np.asfortranarray(np.eye(size)), c=np.zeros(size), G=np.zeros((rows, size), order="F"),
            h_l=np.full(rows, -np.inf), h_u=np.ones(rows),
            x_l=np.concatenate([np.full(moves, -rate), np.zeros(SLACKS)]),
            x_u=np.concatenate([np.full(moves, rate), np.full(SLACKS, np.inf)]),
        )  # fmt: skip
        self.solver = set_up(p)

    def solve(self) -> tuple[piqp.Status, piqp.Result]:
        """Solve what is in `problem`; the result's arrays are overwritten by the next call."""
        p = self.problem
        self.solver.update(P=p.P, c=p.c, G=p.G, h_l=p.h_l, h_u=p.h_u)
        status, result = self.solver.solve(), self.solver.result
        if status != piqp.PIQP_SOLVED:  # stuck, which scaling by PIQP itself mostly heals
            careful = set_up(p, 10)
            status, result = careful.solve(), careful.result
        return status, result


class PiqpSolver:
    """Solves what is stacked in a work space, with few rows first."""

    def __init__(self, moves: int, count: int, rate: float):
        """For QPs of this many moves, bounded by `rate` [rad/s], and lines."""
        self._moves = moves
        self._reduced, self._full = _Rows(moves, NEAREST + RESERVE, rate), _Rows(moves, 2 * count, rate)
        self._used = self._reduced

    @property
    def problem(self) -> Problem:
        """The QP of the last solve; the next one overwrites its arrays."""
        return self._used.problem

    def choose_rows(self, work: NDArray[np.void], last: Array) -> Problem:
        """Write the QP with the rows nearest to the moves `last`, shape (moves,)."""
        self._used, p = self._reduced, self._reduced.problem
        fill_cost(work, self._moves, p.P, p.c)
        fill_rows(work, last, p.G, p.h_l, p.h_u)
        return p

    def solve(self, work: NDArray[np.void], last: Array) -> bool:
        """Leave the optimum in the work space's `z`, with PIQP's figures; whether it is one.

        Args:
            work: Work space record with the stacked QP.
            last: Moves of the last solution, which choose the rows to begin with, shape (moves,).
        """
        self.choose_rows(work, last)
        rows, used, iterations, z = self._used, 0, 0, work["z"][0]
        while True:
            status, result = rows.solve()
            info, solved = result.info, status == piqp.PIQP_SOLVED
            iterations += int(info.iter)
            z[: self._moves + SLACKS] = result.x  # a view that the next solve overwrites
            known, p = used, rows.problem
            used = add_violated(work, used, TOLERANCE, p.G, p.h_u)
            if used == known or not solved or rows is self._full:
                break
            if used > RESERVE:
                rows = self._used = self._full
                fill_cost(work, self._moves, rows.problem.P, rows.problem.c)
                fill_rows(work, last, rows.problem.G, rows.problem.h_l, rows.problem.h_u)
        work["iterations"], work["solver_status"] = iterations, STATUS.get(status, NUMERICS)
        work["primal_residual"], work["dual_residual"] = info.primal_res, info.dual_res
        return solved
