"""The bounds: all lines that have one, and the variables, with their values and how far they are violated."""

import math

import numpy as np

from sidestep.controller.records import PADDING
from sidestep.plant_models.kernels import Record, bare_kernel

LOWER, UPPER = 1, 2
"""Flags of a line whose bounds are active."""
NONE = 1 << 40
"""No bound."""
NO_BOUND = 1e3
"""Bounds from here on are none: a line that has no other takes no time."""
TOLERANCE = 1e-10
"""Violation that is none, in the unit of the line and per 1 + |bound|."""


@bare_kernel
def load(p: Record, w: Record) -> int:
    """Lines that have a bound, as columns, and the variables, with their values; slack bounds active.

    Returns:
        How many there are of them, with padding; -1 if something is not finite or bounds cannot be kept.
    """
    n, slacks, lines = w.moves, w.slacks, p.count
    count, s = 0, 0
    for i in range(lines):
        while s < slacks and i >= w.ends[s]:
            w.edges[s] = count
            s += 1
        low, high = p.low[i] - p.lines[i], p.high[i] - p.lines[i]
        if not (low < np.inf and high > -np.inf):
            return -1
        w.place[i] = -1
        if low > -NO_BOUND or high < NO_BOUND:
            for q in range(n):
                w.columns[q, count] = p.slopes[i, q]
            w.low[count], w.high[count], w.excess[count] = low, high, 1.0 if s < slacks else 0.0
            w.held[count], w.line[count], w.place[i] = 0, i, count
            count += 1
    while s < slacks:
        w.edges[s] = count
        s += 1
    rows = -(-count // PADDING) * PADDING
    for i in range(count, rows):
        _leave_empty(i, w)
        for q in range(n):
            w.columns[q, i] = 0.0
    total = rows + w.width
    evaluate(p, total, w)
    _weigh(n, rows, w)
    finite = 0.0
    for i in range(rows):
        finite += 0.0 * w.value[i]
    return total if finite == 0.0 and _load_variables(p, rows, w) else -1


@bare_kernel
def _weigh(n, rows, w):
    """Distances instead of violations: one over the length of the normals, whose slack part is in `excess`."""
    for q in range(n):
        for i in range(rows):
            w.excess[i] += w.columns[q, i] * w.columns[q, i]
    for i in range(rows):
        w.weight[i] = 1.0 / math.sqrt(w.excess[i] if w.excess[i] > 0.0 else 1.0)


@bare_kernel
def _load_variables(p, rows, w):
    """Bounds of the variables, those of the slacks active; False if one is not finite or cannot be kept."""
    n, slacks, lines, finite = w.moves, w.slacks, p.count, 0.0
    for q in range(w.width):
        _leave_empty(rows + q, w)
    for q in range(n):
        i = rows + q
        w.line[i], w.place[lines + q] = lines + q, i
        w.low[i], w.high[i], w.value[i] = w.x_lower[q], w.x_upper[q], w.x[q]
        finite += 0.0 * w.x[q]
        if not (w.low[i] <= w.high[i] and w.low[i] < np.inf and w.high[i] > -np.inf):
            return False
    for s in range(slacks):
        i = rows + n + s
        w.line[i], w.place[lines + n + s] = lines + n + s, i
        w.low[i], w.held[i], w.active[s], w.u[s] = 0.0, LOWER, ~i, w.price[s]
        finite += 0.0 * w.price[s]
        if not (w.price[s] >= 0.0 and 0.0 < w.curvature[s] < np.inf):
            return False
    return finite == 0.0


@bare_kernel
def _leave_empty(i, w):
    """A place that no bound has."""
    w.low[i], w.high[i], w.value[i], w.weight[i], w.excess[i], w.held[i] = -np.inf, np.inf, 0.0, 1.0, 0.0, 0


@bare_kernel
def most_violated(p: Record, total: int, w: Record) -> int:
    """Bound with the largest violation, as distance: i if upper, ~i if lower; NONE if all are kept."""
    n, begin = w.moves, 0
    for s in range(w.slacks + 1):
        end, slack = (w.edges[s], w.x[n + s]) if s < w.slacks else (total, 0.0)
        for i in range(begin, end):
            below, above = w.low[i] - w.value[i], w.value[i] - w.high[i]
            w.excess[i] = (below if below > above else above) - slack
        begin = end
    worst, found = 0.0, NONE
    for i in range(total):
        excess = w.excess[i]
        if excess > TOLERANCE and excess * w.weight[i] > worst:
            lower = w.low[i] - w.value[i] > w.value[i] - w.high[i]
            bound, side = (w.low[i], LOWER) if lower else (w.high[i], UPPER)
            if excess > TOLERANCE * (1.0 + abs(bound)) and not w.held[i] & side:
                worst, found = excess * w.weight[i], ~i if lower else i
    return found


@bare_kernel
def set_normal(p: Record, code: int, total: int, w: Record) -> float:
    """Normal of a bound, so that normal'x >= what is given back."""
    n, variables, sign = w.moves, total - w.width, 1.0 if code < 0 else -1.0
    i = ~code if code < 0 else code
    w.normal[:] = 0.0
    if i >= variables:
        w.normal[i - variables] = sign
    else:
        for q in range(n):
            w.normal[q] = sign * w.columns[q, i]
        for s in range(w.slacks):
            if i < w.edges[s]:
                w.normal[n + s] = 1.0
                break
    return w.low[i] if code < 0 else -w.high[i]


@bare_kernel
def advance(p: Record, total: int, w: Record) -> None:
    """Move by `step`, values included."""
    variables = total - w.width
    for q in range(w.width):
        w.x[q] += w.step[q]
        w.value[variables + q] = w.x[q]
    for q in range(w.moves):
        slope = w.step[q]
        for i in range(variables):
            w.value[i] += slope * w.columns[q, i]


@bare_kernel
def evaluate(p: Record, total: int, w: Record) -> None:
    """Values of all lines and variables, without what has gathered in rounding."""
    variables = total - w.width
    w.value[:variables] = 0.0
    for q in range(w.width):
        w.value[variables + q] = w.x[q]
    for q in range(w.moves):
        slope = w.x[q]
        for i in range(variables):
            w.value[i] += slope * w.columns[q, i]
