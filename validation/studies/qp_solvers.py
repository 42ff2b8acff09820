"""The QP solvers that the bench compares, each fed the controller's own QPs in the way that suits it.

A solver is made for the first problem, and gives a function that solves that one and others of its size. Solvers
that can are updated, not set up anew: that is how the controller uses PIQP.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from time import perf_counter_ns

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from sidestep.controller.mpc.piqp_solver import Problem, set_up

Array = NDArray[np.float64]
Solve = Callable[[Problem], Array]
"""Solves a problem; gives z, not a number where it failed."""

OSQP_ACCURACY = 1e-5
"""Absolute and relative tolerance; OSQP's own 1e-3 leaves steering errors that are no use."""


def _piqp(first: Problem) -> Solve:
    solver = set_up(first)

    def solve(p: Problem) -> Array:
        solver.update(P=p.P, c=p.c, G=p.G, h_l=p.h_l, h_u=p.h_u)
        solver.solve()
        return np.array(solver.result.x)

    return solve


def _daqp(first: Problem) -> Solve:
    daqp = import_module("daqp")

    def solve(p: Problem) -> Array:
        upper, lower = np.concatenate([p.x_u, p.h_u]), np.concatenate([p.x_l, p.h_l])
        z, _, status, _ = daqp.solve(p.P, p.c, p.G, upper, lower, primal_tol=1e-10)
        return z if status == 1 else np.full_like(p.c, np.nan)

    return solve


def _osqp(first: Problem) -> Solve:
    osqp = import_module("osqp")
    size = len(first.c)
    cost, rows = _Pattern(np.triu(np.ones((size, size)))), _Pattern(np.vstack([np.ones_like(first.G), np.eye(size)]))
    solver = osqp.OSQP()
    solver.setup(
        cost.matrix, first.c, rows.matrix, *_osqp_bounds(first),
        eps_abs=OSQP_ACCURACY, eps_rel=OSQP_ACCURACY, max_iter=100_000, verbose=False,
    )  # fmt: skip

    def solve(p: Problem) -> Array:
        lower, upper = _osqp_bounds(p)
        solver.update(
            Px=cost.values(p.P), q=p.c, Ax=rows.values(np.vstack([p.G, np.eye(size)])), l=lower, u=upper
        )  # fmt: skip
        return np.array(solver.solve(raise_error=False).x)

    return solve


def _osqp_bounds(p: Problem) -> tuple[Array, Array]:
    return np.concatenate([p.h_l, p.x_l]), np.concatenate([p.h_u, p.x_u])


def _clarabel(first: Problem) -> Solve:
    clarabel = import_module("clarabel")
    size = len(first.c)
    cost = _Pattern(np.triu(np.ones((size, size))))
    settings = clarabel.DefaultSettings()
    settings.verbose = False

    def solve(p: Problem) -> Array:
        rows = np.vstack([p.G, -p.G, np.eye(size), -np.eye(size)])
        bounds = np.concatenate([p.h_u, -p.h_l, p.x_u, -p.x_l])
        real = np.isfinite(bounds)
        cones = [clarabel.NonnegativeConeT(int(real.sum()))]
        cost.values(p.P)
        solver = clarabel.DefaultSolver(cost.matrix, p.c, csc_matrix(rows[real]), bounds[real], cones, settings)
        return np.array(solver.solve().x)

    return solve


class _Pattern:
    """A sparse matrix of fixed pattern and the values of dense matrices in it."""

    def __init__(self, ones: Array):
        self.matrix = csc_matrix(ones)
        self._values = np.asarray(self.matrix.data, dtype=np.float64)  # a view
        self._places = self.matrix.indices, np.repeat(np.arange(ones.shape[1]), np.diff(self.matrix.indptr))

    def values(self, dense: Array) -> Array:
        self._values[:] = dense[self._places]
        return self._values


_MAKERS = {"piqp": _piqp, "osqp": _osqp, "daqp": _daqp, "clarabel": _clarabel}


def installed_solvers() -> tuple[str, ...]:
    """Names of the solvers that are here; all but PIQP come with the extra `bench`."""
    return tuple(name for name in _MAKERS if find_spec(name))


def solve_all(name: str, problems: Sequence[Problem]) -> tuple[Array, list[Array]]:
    """Solve recorded problems in their order, the solver warm where it can be.

    Args:
        name: One of `installed_solvers()`.
        problems: Of any sizes; every size has a solver of its own.

    Returns:
        Time of each solve, in [us], the conversion of its data included, and each z.
    """
    solvers: dict[tuple[int, ...], Solve] = {}
    times, solutions = np.empty(len(problems)), []
    for i, problem in enumerate(problems):
        solve = solvers.get(problem.G.shape) or solvers.setdefault(problem.G.shape, _MAKERS[name](problem))
        began = perf_counter_ns()
        solutions.append(solve(problem))
        times[i] = (perf_counter_ns() - began) / 1000.0
    return times, solutions
