"""The few rows that PIQP is asked about.

Of all bounds few matter in one step: those that the last solution came nearest to get a row, and one of the reserve
goes to each other bound that a solution violates, until none is. When the reserve does not suffice, the problem is
solved once more with both rows of every line.
"""

import numpy as np

from sidestep.controller.mpc.stack import SLACK_UNIT
from sidestep.controller.mpc.unconstrained import line_value
from sidestep.controller.records import SLACKS
from sidestep.plant_models.kernels import Array, Records, kernel

NEAREST, RESERVE = 20, 12
"""Rows to begin with, and to add: another round costs more than twenty rows."""


@kernel
def fill_cost(work: Records, moves: int, P: Array, c: Array) -> None:
    """Copy the stacked cost into matrices of the solver's size."""
    w, size = work[0], moves + SLACKS
    for i in range(size):
        c[i] = w.q[i]
        for j in range(size):
            P[i, j] = w.P[i, j]


@kernel
def fill_rows(work: Records, last: Array, G: Array, h_l: Array, h_u: Array) -> None:
    """Rows: the bounds nearest to the last solution and an empty reserve; all bounds if G has room for them.

    Args:
        work: Work space record with the stacked lines.
        last: Moves of the last solution, shape (moves,).
        G, h_l, h_u: Filled, shapes (R, n), (R,), (R,).
    """
    w = work[0]
    G[:, :] = 0.0
    h_l[:], h_u[:] = -np.inf, 1.0  # empty rows never act
    count, rows = w.count, h_u.shape[0]
    if rows == 2 * count:
        for i in range(count):
            _put_row(i, i, True, w, G, h_u)
            _put_row(count + i, i, False, w, G, h_u)
        return
    below, above = np.empty(count), np.empty(count)
    for i in range(count):
        value = w.lines[i]
        for q in range(last.shape[0]):
            value += w.slopes[i, q] * last[q]
        below[i], above[i] = value - w.low[i], w.high[i] - value  # metres and radians alike
    nearest = np.argsort(np.minimum(below, above))
    for row in range(min(rows - RESERVE, count)):
        i = nearest[row]
        _put_row(row, i, above[i] < below[i], w, G, h_u)


@kernel
def _put_row(row, i, upper, w, G, h_u):
    """Write one bound of line i into a row: sign (line - bound) <= slack."""
    sign, bound = (1.0, w.high[i]) if upper else (-1.0, w.low[i])
    moves = G.shape[1] - SLACKS
    for q in range(moves):
        G[row, q] = sign * w.slopes[i, q]
    for slack in range(SLACKS):
        G[row, moves + slack] = -SLACK_UNIT if slack == w.slack[i] else 0.0
    h_u[row] = sign * (bound - w.lines[i])


@kernel
def add_violated(work: Records, used: int, tolerance: float, G: Array, h_u: Array) -> int:
    """Move violated bounds that have no row yet into the reserve.

    Args:
        work: Work space record with the stacked lines and the solution `z`.
        used: Reserve rows in use.
        tolerance: Violation that is let pass, in [m] or [rad].
        G, h_u: See `fill_rows`.

    Returns:
        Reserve rows in use now: more than RESERVE if it did not suffice.
    """
    w, moves, begin = work[0], G.shape[1] - SLACKS, h_u.shape[0] - RESERVE
    for i in range(w.count):
        value, slack = line_value(i, w, moves), w.slack[i]
        allowed = max(w.z[moves + slack], 0.0) * SLACK_UNIT if slack < SLACKS else 0.0
        if max(w.low[i] - value, value - w.high[i]) > allowed + tolerance:
            if used < RESERVE:
                _put_row(begin + used, i, value > w.high[i], w, G, h_u)
            used += 1
    return used
