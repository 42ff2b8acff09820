"""A dense dual active set (Goldfarb and Idnani, Mathematical Programming 27, 1983) for the QP of the MPC.

    min  1/2 m'Pm + q'm + sum over slacks of (1/2 curvature s^2 + price s)
    with low - s <= value + slope m <= high + s,  |m| <= rate,  s >= 0

Lines come in order of their slack (`ends`), those without one last. The start is the optimum without lines and
slack; each iteration adds the most violated bound and drops those whose multiplier would turn negative, so that the
cost only grows and no set of active bounds comes twice. With N the normals of the active bounds, J holds
J'PJ = I and J'N = [R; 0]: what is added reflects J (Householder), what is dropped rotates it (Givens). At the end
one step of iterative refinement takes the rounding out that has gathered.

All memory comes in as arguments; loops go over padded arrays, which the compiler makes vectors of.
"""

import math

import numpy as np

from sidestep.controller.mpc.stack import SLACK_CURVATURE, SLACK_UNIT
from sidestep.controller.mpc.status import INFEASIBLE as INFEASIBLE_STEP
from sidestep.controller.mpc.status import ITERATION_LIMIT, NUMERICS
from sidestep.controller.mpc.status import SOLVED as SOLVED_STEP
from sidestep.controller.records import PADDING, SLACKS
from sidestep.plant_models.kernels import kernel

SOLVED, INFEASIBLE, EXHAUSTED, INVALID = 0, 1, 2, 3
"""Optimum; hard bounds that contradict each other; more iterations than allowed; not finite, or P not positive."""
MOST_ITERATIONS = 200
"""Five times what the worst step of the recorded drives takes."""
TOLERANCE = 1e-10
"""Violation that is none, in the unit of the line and per 1 + |bound|."""
DEPENDENT = 1e-20
"""A normal is a combination of the active ones if this share of its square or less is not."""
DEPENDENT_WARM = 1e-12
"""The same for bounds of an earlier solution, which may just as well be left out."""
NEGLIGIBLE = 1e-12
"""A multiplier does not change if it does by less than this share of the one that changes most."""
SINGULAR = 1e-14
"""H counts as singular if a pivot is this share of its diagonal or less."""
NONE = 1 << 40
"""No bound."""
NO_BOUND = 1e3
"""Bounds from here on are none: a line that has no other takes no time."""
LOWER, UPPER = 1, 2
"""Flags of a line whose bounds are active."""


@kernel
def solve_with_bounds(m, p, c):
    """Solve the stacked QP, beginning with the active bounds of the last step.

    Args:
        m: Memory; keeps the active bounds.
        p: Work space with the stacked QP; `z` and the solver's figures are filled.
        c: Settings.

    Returns:
        Whether that gave the optimum.
    """
    w = p.active
    w.moves, w.slacks, w.rate = c.grid.moves, SLACKS, c.car.rate_limit
    w.width = -(-(w.moves + SLACKS) // PADDING) * PADDING
    w.price[0], w.price[1] = c.weights.corridor, c.weights.slip
    w.curvature[0] = w.curvature[1] = SLACK_CURVATURE
    w.ends[0] = 2 * (c.grid.nodes - c.grid.first)
    w.ends[1] = w.ends[0] + 2 * c.grid.slips
    status, p.iterations = solve(p, m.active, MOST_ITERATIONS, w)
    p.solver_status = NUMERICS
    if status == SOLVED:
        p.solver_status = SOLVED_STEP
    elif status == INFEASIBLE:
        p.solver_status = INFEASIBLE_STEP
    elif status == EXHAUSTED:
        p.solver_status = ITERATION_LIMIT
    p.primal_residual = p.dual_residual = 0.0
    return status == SOLVED


@kernel
def solve(p, result, limit, w):
    """Solve a problem, beginning with the active bounds that `result` holds.

    Args:
        p: Record of `WORK` with the stacked QP; `z` is filled.
        result: Record of `ACTIVE_SET`; where to begin is overwritten with where it ends, also if that is no optimum.
        limit: Bounds to be added and dropped at most.
        w: Record of `ACTIVE`, p.active, with sizes, prices and bounds of the moves.

    Returns:
        SOLVED, INFEASIBLE, EXHAUSTED or INVALID, and the number of iterations: 0 if the optimum without lines and
        slack is the optimum.
    """
    warm, slacks = result.count, w.slacks
    result.count = 0
    if not _eliminate(p, w):
        return INVALID, 0
    total = _load(p, w)
    if total < 0:
        return INVALID, 0
    status, iterations, count = SOLVED, 0, slacks
    if _most_violated(p, total, w) != NONE:
        count = _begin(p, result, warm, total, w)
        _evaluate(p, total, w)
        status, iterations, count = _iterate(p, limit, total, count, w)
    _hand_over(p, result, count, w)
    return status, iterations


@kernel
def _eliminate(p, w):
    """Columns of J for the moves, and the optimum without lines; False if H is not positive or not finite.

    Elimination turns H = L D L' and -g into D and L^-1 (in place of the zeros) and into -L^-1 g; J = L^-T D^-1/2.
    """
    n, slacks, a, x, width = w.moves, w.slacks, w.factor, w.x, w.width
    for i in range(n):
        for j in range(n):
            a[i, j] = p.P[i, j]
        a[i, n] = -p.q[i]
    for k in range(n):
        if not a[k, k] > SINGULAR * p.P[k, k] or not a[k, k] < np.inf:
            return False
        for i in range(k + 1, n):
            factor = a[i, k] / a[k, k]
            for j in range(width):
                a[i, j] -= factor * a[k, j]
            a[i, k] = -factor
    x[:] = 0.0
    for i in range(n):
        scale = 1.0 / math.sqrt(a[i, i])
        part = scale * a[i, n]
        a[i, i] = 1.0
        for j in range(w.width):
            value = scale * a[i, j] if j <= i else 0.0
            w.J[slacks + i, j] = value
            x[j] += part * value
    return True


@kernel
def _load(p, w):
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
            w.flags[count], w.line[count], w.place[i] = 0, i, count
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
    _evaluate(p, total, w)
    _weigh(n, rows, w)
    finite = 0.0
    for i in range(rows):
        finite += 0.0 * w.value[i]
    return total if finite == 0.0 and _load_variables(p, rows, w) else -1


@kernel
def _weigh(n, rows, w):
    """Distances instead of violations: one over the length of the normals, whose slack part is in `excess`."""
    for q in range(n):
        for i in range(rows):
            w.excess[i] += w.columns[q, i] * w.columns[q, i]
    for i in range(rows):
        w.weight[i] = 1.0 / math.sqrt(w.excess[i] if w.excess[i] > 0.0 else 1.0)


@kernel
def _load_variables(p, rows, w):
    """Bounds of the variables, those of the slacks active; False if one is not finite or cannot be kept."""
    n, slacks, lines, finite = w.moves, w.slacks, p.count, 0.0
    for q in range(w.width):
        _leave_empty(rows + q, w)
    for q in range(n):
        i = rows + q
        w.line[i], w.place[lines + q] = lines + q, i
        w.low[i], w.high[i], w.value[i] = -w.rate, w.rate, w.x[q]
        finite += 0.0 * w.x[q]
        if not (w.low[i] <= w.high[i] and w.low[i] < np.inf and w.high[i] > -np.inf):
            return False
    for s in range(slacks):
        i = rows + n + s
        w.line[i], w.place[lines + n + s] = lines + n + s, i
        w.low[i], w.flags[i], w.active[s], w.u[s] = 0.0, LOWER, ~i, w.price[s]
        finite += 0.0 * w.price[s]
        if not (w.price[s] >= 0.0 and 0.0 < w.curvature[s] < np.inf):
            return False
    return finite == 0.0


@kernel
def _leave_empty(i, w):
    """A place that no bound has."""
    w.low[i], w.high[i], w.value[i], w.weight[i], w.excess[i], w.flags[i] = -np.inf, np.inf, 0.0, 1.0, 0.0, 0


@kernel
def _most_violated(p, total, w):
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
            if excess > TOLERANCE * (1.0 + abs(bound)) and not w.flags[i] & side:
                worst, found = excess * w.weight[i], ~i if lower else i
    return found


@kernel
def _begin(p, result, warm, total, w):
    """J and R of the slack bounds, then of the other bounds of an earlier solution; gives their count."""
    n, slacks, lines, variables = w.moves, w.slacks, p.count, total - w.width
    if warm > 0:
        for s in range(slacks):
            w.flags[variables + n + s] = 0
        for c in range(min(warm, n + slacks)):
            s = -1 - result.active[c] - lines - n
            if 0 <= s < slacks:
                w.flags[variables + n + s] = LOWER
    count, last = 0, slacks
    for s in range(slacks):
        scale = 1.0 / math.sqrt(w.curvature[s])
        if w.flags[variables + n + s]:
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


@kernel
def _add_earlier(p, result, warm, count, total, w):
    n, slacks, lines = w.moves, w.slacks, p.count
    for c in range(min(warm, n + slacks)):
        code = result.active[c]
        upper, number = code >= 0, code if code >= 0 else ~code
        if number >= lines + n + slacks or w.place[number] < 0:
            continue
        i = w.place[number]
        side, bound = (UPPER, w.high[i]) if upper else (LOWER, w.low[i])
        if w.flags[i] & side or not abs(bound) < np.inf or count == n + slacks:
            continue
        _set_normal(p, i if upper else ~i, total, w)
        square, fresh = _project(n + slacks, count, w)
        if fresh > DEPENDENT_WARM * square:
            _add(n + slacks, count, fresh, i if upper else ~i, 0.0, w)
            count += 1
    while True:
        _settle(p, count, total, w)
        kept = count
        for c in range(count - 1, -1, -1):
            if w.u[c] < 0.0:
                _drop(kept, c, w)
                kept -= 1
        if kept == count:
            return count
        count = kept


@kernel
def _set_normal(p, code, total, w):
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


@kernel
def _project(size, count, w):
    """J'normal, the part z of the normal that the active ones leave free, and the squares of both."""
    square, fresh = 0.0, 0.0
    w.z[:] = 0.0
    for j in range(size):
        value = 0.0
        for q in range(size):
            value += w.J[j, q] * w.normal[q]
        w.along[j] = value
        square += value * value
    for j in range(count, size):
        value = w.along[j]
        fresh += value * value
        for q in range(w.width):
            w.z[q] += value * w.J[j, q]
    return square, fresh


@kernel
def _add(size, count, fresh, code, multiplier, w):
    """Make the projected normal the next column of R, by a reflection of J's free columns."""
    first = w.along[count]
    root = math.sqrt(fresh)
    pivot = -root if first > 0.0 else root
    for j in range(count):
        w.R[count, j] = w.along[j]
    w.R[count, count] = pivot
    scale = 1.0 / (root * (root + abs(first)))
    w.along[count] = first - pivot
    for q in range(w.width):
        w.z[q] = scale * (w.z[q] - pivot * w.J[count, q])
    for j in range(count, size):
        factor = w.along[j]
        for q in range(w.width):
            w.J[j, q] -= factor * w.z[q]
    w.active[count], w.u[count] = code, multiplier
    w.flags[~code if code < 0 else code] |= LOWER if code < 0 else UPPER


@kernel
def _drop(count, place, w):
    """Take an active bound out, by rotations that make R triangular again."""
    code = w.active[place]
    w.flags[~code if code < 0 else code] &= ~(LOWER if code < 0 else UPPER)
    for c in range(place, count - 1):
        w.active[c], w.u[c] = w.active[c + 1], w.u[c + 1]
        for j in range(c + 2):
            w.R[c, j] = w.R[c + 1, j]
    for c in range(place, count - 1):
        a, b = w.R[c, c], w.R[c, c + 1]
        root = math.sqrt(a * a + b * b)
        cosine, sine = a / root, b / root
        w.R[c, c] = root
        for i in range(c + 1, count - 1):
            a, b = w.R[i, c], w.R[i, c + 1]
            w.R[i, c], w.R[i, c + 1] = cosine * a + sine * b, cosine * b - sine * a
        a, b = w.along[c], w.along[c + 1]
        w.along[c], w.along[c + 1] = cosine * a + sine * b, cosine * b - sine * a
        for q in range(w.width):
            a, b = w.J[c, q], w.J[c + 1, q]
            w.J[c, q], w.J[c + 1, q] = cosine * a + sine * b, cosine * b - sine * a


@kernel
def _solve_triangle(count, w):
    """R = R^-1 r."""
    for i in range(count - 1, -1, -1):
        value = w.r[i] / w.R[i, i]
        w.r[i] = value
        for j in range(i):
            w.r[j] -= value * w.R[i, j]


@kernel
def _iterate(p, limit, total, count, w):
    """Take the most violated bound in until there is none."""
    iterations, settled = 0, False
    while True:
        code = _most_violated(p, total, w)
        if code == NONE:
            if settled:
                return SOLVED, iterations, count
            _settle(p, count, total, w)
            _evaluate(p, total, w)
            settled = True
            continue
        settled = False
        status, iterations, count = _take_in(p, code, limit, iterations, total, count, w)
        if status != SOLVED:
            return status, iterations, count


@kernel
def _take_in(p, code, limit, iterations, total, count, w):
    """Raise the multiplier of a bound until it is kept, dropping those that reach 0 on the way."""
    size = w.moves + w.slacks
    _set_normal(p, code, total, w)
    square, fresh = _project(size, count, w)
    missing, multiplier = w.excess[~code if code < 0 else code], 0.0
    w.step[:] = 0.0
    while iterations < limit:
        iterations += 1
        for c in range(count):
            w.r[c] = w.along[c]
        _solve_triangle(count, w)
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
            _add(size, count, fresh, code, multiplier, w)
            _advance(p, total, w)
            return SOLVED, iterations, count + 1
        _drop(count, blocking, w)
        count -= 1
        value = w.along[count]
        fresh += value * value
        for q in range(w.width):
            w.z[q] += value * w.J[count, q]
    return EXHAUSTED, iterations, count


@kernel
def _advance(p, total, w):
    """Move by `step`, values included."""
    variables = total - w.width
    for q in range(w.width):
        w.x[q] += w.step[q]
        w.value[variables + q] = w.x[q]
    for q in range(w.moves):
        slope = w.step[q]
        for i in range(variables):
            w.value[i] += slope * w.columns[q, i]


@kernel
def _evaluate(p, total, w):
    """Values of all lines and variables, without what has gathered in rounding."""
    variables = total - w.width
    w.value[:variables] = 0.0
    for q in range(w.width):
        w.value[variables + q] = w.x[q]
    for q in range(w.moves):
        slope = w.x[q]
        for i in range(variables):
            w.value[i] += slope * w.columns[q, i]


@kernel
def _settle(p, count, total, w):
    """One Newton step on the conditions of optimality with these active bounds: exact but for rounding."""
    n, size = w.moves, w.moves + w.slacks
    for q in range(n):
        w.rhs[q] = p.q[q]
    for s in range(n, size):
        w.rhs[s] = w.price[s - n] + w.curvature[s - n] * w.x[s]
    for j in range(n):
        for q in range(n):
            w.rhs[q] += w.x[j] * p.P[j, q]
    for c in range(count):
        missing = _set_normal(p, w.active[c], total, w)
        for q in range(size):
            w.rhs[q] -= w.u[c] * w.normal[q]
            missing -= w.normal[q] * w.x[q]
        for j in range(c):
            missing -= w.R[c, j] * w.z[j]
        w.z[c] = missing / w.R[c, c]
    for j in range(size):
        value = 0.0
        for q in range(size):
            value += w.J[j, q] * w.rhs[q]
        if j < count:
            w.r[j] = w.z[j] + value
        else:
            w.z[j] = -value
    _solve_triangle(count, w)
    for c in range(count):
        w.u[c] += w.r[c]
    for j in range(size):
        for q in range(size):
            w.x[q] += w.z[j] * w.J[j, q]


@kernel
def _hand_over(p, result, count, w):
    """Solution and active bounds, in the caller's numbers."""
    for q in range(w.moves):
        p.z[q] = w.x[q]
    for s in range(w.slacks):
        p.z[w.moves + s] = max(w.x[w.moves + s], 0.0) / SLACK_UNIT
    for c in range(count):
        code = w.active[c]
        result.active[c] = ~w.line[~code] if code < 0 else w.line[code]
        w.multipliers[c] = max(w.u[c], 0.0)
    result.count = count
