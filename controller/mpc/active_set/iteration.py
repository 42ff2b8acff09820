"""A dense dual active set (Goldfarb and Idnani, Mathematical Programming 27, 1983) for the QP of the MPC.

    min  1/2 m'Pm + q'm + sum over slacks of (1/2 curvature s^2 + price s)
    with low - s <= value + slopes m <= high + s,  x_lower <= m <= x_upper,  s >= 0

Lines come in order of their slack (`ends`), those without one last. The start is the optimum without lines and
slack; each iteration adds the most violated bound and drops those whose multiplier would turn negative, so that the
cost only grows and no set of active bounds comes twice. With N the normals of the active bounds, J holds
J'PJ = I and J'N = [R; 0]: what is added reflects J (Householder), what is dropped rotates it (Givens). At the end
one step of iterative refinement takes the rounding out that has gathered.

All memory comes in as arguments; loops go over padded arrays, which the compiler makes vectors of.
"""

import math

import numpy as np

from sidestep.controller.mpc.active_set.factors import add, drop, eliminate, project, settle, solve_triangle
from sidestep.controller.mpc.active_set.lines import (
    LOWER,
    NONE,
    UPPER,
    advance,
    evaluate,
    load,
    most_violated,
    set_normal,
)
from sidestep.controller.mpc.stack import SLACK_UNIT
from sidestep.plant_models.kernels import Record, bare_kernel

SOLVED, INFEASIBLE, EXHAUSTED, INVALID = 0, 1, 2, 3
"""Optimum; hard bounds that contradict each other; more iterations than allowed; not finite, or P not positive."""
DEPENDENT = 1e-20
"""A normal is a combination of the active ones if this share of its square or less is not."""
DEPENDENT_WARM = 1e-12
"""The same for bounds of an earlier solution, which may just as well be left out."""
NEGLIGIBLE = 1e-12
"""A multiplier does not change if it does by less than this share of the one that changes most."""


@bare_kernel
def solve(p: Record, result: Record, limit: int, w: Record) -> tuple[int, int]:
    """Solve a problem, beginning with the active bounds that `result` holds.

    Args:
        p: Record of `WORK` with the stacked QP; `z` is filled.
        result: Record of `ACTIVE_SET`; where to begin is overwritten with where it ends, also if that is no optimum.
        limit: Bounds to be added and dropped at most.
        w: Record of `ACTIVE`: p.active, with sizes, prices and bounds of the moves.

    Returns:
        SOLVED, INFEASIBLE, EXHAUSTED or INVALID, and the number of iterations: 0 if the optimum without lines and
        slack is the optimum.
    """
    warm, slacks = result.count, w.slacks
    result.count = 0
    if not eliminate(p, w):
        return INVALID, 0
    total = load(p, w)
    if total < 0:
        return INVALID, 0
    status, iterations, count = SOLVED, 0, slacks
    if most_violated(p, total, w) != NONE:
        count = _begin(p, result, warm, total, w)
        evaluate(p, total, w)
        status, iterations, count = _iterate(p, limit, total, count, w)
    _hand_over(p, result, count, w)
    return status, iterations


@bare_kernel
def _begin(p, result, warm, total, w):
    """J and R of the slack bounds, then of the other bounds of an earlier solution; gives their count."""
    n, slacks, lines, variables = w.moves, w.slacks, p.count, total - w.width
    if warm > 0:
        for s in range(slacks):
            w.held[variables + n + s] = 0
        for c in range(min(warm, n + slacks)):
            s = -1 - result.active[c] - lines - n
            if 0 <= s < slacks:
                w.held[variables + n + s] = LOWER
    count, last = 0, slacks
    for s in range(slacks):
        scale = 1.0 / math.sqrt(w.curvature[s])
        if w.held[variables + n + s]:
            w.R[count, :] = 0.0
            w.R[count, count] = scale
            w.active[count], w.u[count] = ~(variables + n + s), w.price[s]
            column, count = count, count + 1
        else:
            w.x[n + s] = -w.price[s] / w.curvature[s]
            column = last = last - 1
        w.J[column, :] = 0.0
        w.J[column, n + s] = scale
    return count if warm == 0 else _add_earlier(p, result, warm, count, total, w)


@bare_kernel
def _add_earlier(p, result, warm, count, total, w):
    n, slacks, lines = w.moves, w.slacks, p.count
    for c in range(min(warm, n + slacks)):
        code = result.active[c]
        upper, number = code >= 0, code if code >= 0 else ~code
        if number >= lines + n + slacks or w.place[number] < 0:
            continue
        i = w.place[number]
        side, bound = (UPPER, w.high[i]) if upper else (LOWER, w.low[i])
        if w.held[i] & side or not abs(bound) < np.inf or count == n + slacks:
            continue
        set_normal(p, i if upper else ~i, total, w)
        square, fresh = project(n + slacks, count, w)
        if fresh > DEPENDENT_WARM * square:
            add(n + slacks, count, fresh, i if upper else ~i, 0.0, w)
            count += 1
    while True:
        settle(p, count, total, w)
        kept = count
        for c in range(count - 1, -1, -1):
            if w.u[c] < 0.0:
                drop(kept, c, w)
                kept -= 1
        if kept == count:
            return count
        count = kept


@bare_kernel
def _iterate(p, limit, total, count, w):
    """Take the most violated bound in until there is none."""
    iterations, settled = 0, False
    while True:
        code = most_violated(p, total, w)
        if code == NONE:
            if settled:
                return SOLVED, iterations, count
            settle(p, count, total, w)
            evaluate(p, total, w)
            settled = True
            continue
        settled = False
        status, iterations, count = _take_in(p, code, limit, iterations, total, count, w)
        if status != SOLVED:
            return status, iterations, count


@bare_kernel
def _take_in(p, code, limit, iterations, total, count, w):
    """Raise the multiplier of a bound until it is kept, dropping those that reach 0 on the way."""
    size = w.moves + w.slacks
    set_normal(p, code, total, w)
    square, fresh = project(size, count, w)
    missing, multiplier = w.excess[~code if code < 0 else code], 0.0
    w.step[:] = 0.0
    while iterations < limit:
        iterations += 1
        for c in range(count):
            w.r[c] = w.along[c]
        solve_triangle(count, w)
        largest, shortest, blocking = 0.0, np.inf, -1
        for c in range(count):
            largest = max(largest, abs(w.r[c]))
        for c in range(count):
            if w.r[c] > NEGLIGIBLE * largest and w.u[c] < shortest * w.r[c]:
                shortest, blocking = w.u[c] / w.r[c], c
        free = fresh > DEPENDENT * square
        full = missing / fresh if free else np.inf
        length = min(full, shortest)
        if not length < np.inf:
            return INFEASIBLE, iterations, count
        for c in range(count):
            w.u[c] = max(w.u[c] - length * w.r[c], 0.0)
        multiplier += length
        if free:
            missing -= length * fresh
            for q in range(w.width):
                w.step[q] += length * w.z[q]
        if full <= shortest:
            add(size, count, fresh, code, multiplier, w)
            advance(p, total, w)
            return SOLVED, iterations, count + 1
        drop(count, blocking, w)
        count -= 1
        value = w.along[count]
        fresh += value * value
        for q in range(w.width):
            w.z[q] += value * w.J[count, q]
    return EXHAUSTED, iterations, count


@bare_kernel
def _hand_over(p, result, count, w):
    """Solution and active bounds, in the caller's numbers and units."""
    for q in range(w.moves):
        p.z[q] = w.x[q]
    for s in range(w.slacks):
        p.z[w.moves + s] = max(w.x[w.moves + s], 0.0) / SLACK_UNIT
    for c in range(count):
        code = w.active[c]
        result.active[c] = ~w.line[~code] if code < 0 else w.line[code]
        w.multipliers[c] = max(w.u[c], 0.0)
    result.count = count
