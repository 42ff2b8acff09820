"""The optimum without bounds: mostly it keeps them all, and is the optimum."""

from sidestep.controller.records import SLACKS
from sidestep.plant_models.kernels import Record, kernel


@kernel
def solve_freely(w: Record, c: Record) -> bool:
    """Optimum without bounds and slacks, by elimination: P is positive definite and needs no pivots.

    Args:
        w: Work space with the stacked QP; `z` is filled.
        c: Settings.

    Returns:
        Whether there is one and it keeps all bounds; as slack only costs, no other z is better then.
    """
    moves, a, z = c.grid.moves, w.elimination, w.z
    for i in range(moves):
        for j in range(moves):
            a[i, j] = w.P[j, i]
        a[i, moves] = -w.q[i]
    for k in range(moves):
        if not a[k, k] > 0.0:  # convex on paper only, to the last digit
            return False
        for i in range(k + 1, moves):
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, moves + 1):
                a[i, j] -= factor * a[k, j]
    z[: moves + SLACKS] = 0.0
    for i in range(moves - 1, -1, -1):
        value = a[i, moves]
        for j in range(i + 1, moves):
            value -= a[i, j] * z[j]
        z[i] = value / a[i, i]
        if abs(z[i]) > c.car.rate_limit:
            return False
    for i in range(w.count):
        value = line_value(i, w, moves)
        if not w.low[i] <= value <= w.high[i]:
            return False
    return True


@kernel
def line_value(i: int, w: Record, moves: int) -> float:
    """Value of line i at the moves of `z`."""
    value = w.lines[i]
    for q in range(moves):
        value += w.slopes[i, q] * w.z[q]
    return value
