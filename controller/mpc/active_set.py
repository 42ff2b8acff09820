"""A dense dual active set (Goldfarb and Idnani, Mathematical Programming 27, 1983) for the QP of the MPC.

    min  1/2 m'Hm + g'm + sum over slacks of (1/2 curvature s^2 + price s)
    with lower - s <= G m <= upper + s,  x_lower <= m <= x_upper,  s >= 0

Lines come in order of their slack (`ends`), those without one last. The start is the optimum without lines and
slack; each iteration adds the most violated bound and drops those whose multiplier would turn negative, so that the
cost only grows and no set of active bounds comes twice. With N the normals of the active bounds, J holds
J'HJ = I and J'N = [R; 0]: what is added reflects J (Householder), what is dropped rotates it (Givens). At the end
one step of iterative refinement takes the rounding out that has gathered.

All memory comes in as arguments; loops go over padded arrays, which the compiler makes vectors of.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SOLVED, INFEASIBLE, EXHAUSTED, INVALID = 0, 1, 2, 3
"""Optimum; hard bounds that contradict each other; more iterations than allowed; not finite, or H not positive."""
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
PADDING = 16
"""Arrays are padded to multiples of this: four vectors of four numbers."""
LOWER, UPPER = 1, 2
"""Flags of a line whose bounds are active."""


class Problem(NamedTuple):
    """One QP with n moves, k slacks and l lines.

    Attributes:
        H, g: Cost of the moves, shapes (n, n) and (n,); H symmetric, positive definite.
        G, lower, upper: Lines, shapes (l, n), (l,) and (l,); the bounds may be infinite, on soft lines they may cross.
        x_lower, x_upper: Bounds of the moves, shape (n,).
        price, curvature: Cost of the slacks, shape (k,); both positive.
        ends: Lines before ends[s] and from ends[s - 1] on are softened by slack s, shape (k,).
    """

    H: Array
    g: Array
    G: Array
    lower: Array
    upper: Array
    x_lower: Array
    x_upper: Array
    price: Array
    curvature: Array
    ends: Indices


class Result(NamedTuple):
    """What is left of a solve, and where the next one may begin.

    Attributes:
        x: Moves, then slacks, shape (n + k,).
        active: Active bounds in the order they came, shape (n + k,): line i, or l + i for variable i, at its upper
            bound; the same number's complement, ~i, at the lower.
        multipliers: Of the active bounds, not negative, shape (n + k,).
        count: How many bounds are active, shape (1,).
    """

    x: Array
    active: Indices
    multipliers: Array
    count: Indices


class Work(NamedTuple):
    """Work space: nothing in it outlasts a solve. Made by `work_space`.

    Attributes:
        factor: H and -g in elimination.
        J, R: One row per column of the matrix.
        columns: G, one row per move; lines without a bound are left out.
        x, step, normal, along, z, r, u, rhs: Variables, their change, a normal, J'normal, the part of the normal that
            is new, change of the multipliers, multipliers, a right-hand side.
        low, high, weight, value, excess: Of the lines left, padded, then of the variables.
        line: Number of each of these in `Result.active`.
        place: Where that number is here; -1 if left out.
        edges: Ends of the lines of each slack here.
        active, flags: Active bounds, and which of each line are.
    """

    factor: Array
    J: Array
    R: Array
    columns: Array
    x: Array
    step: Array
    normal: Array
    along: Array
    z: Array
    r: Array
    u: Array
    rhs: Array
    low: Array
    high: Array
    weight: Array
    value: Array
    excess: Array
    line: Indices
    place: Indices
    edges: Indices
    active: Indices
    flags: Indices


def padded(size: int) -> int:
    """The next multiple of PADDING."""
    return -(-size // PADDING) * PADDING


def work_space(moves: int, slacks: int, lines: int) -> Work:
    """Memory for problems of this size."""
    n, width, rows = moves + slacks, padded(moves + slacks), padded(lines)
    squares = (np.zeros((moves, padded(moves + 1))), np.zeros((n, width)), np.zeros((n, width)), np.zeros((moves, rows)))
    vectors, bounds = (np.zeros(width) for _ in range(8)), (np.zeros(rows + width) for _ in range(5))
    indices = (np.zeros(size, dtype=np.int64) for size in (rows + width, lines + n, slacks, width, rows + width))
    return Work(*squares, *vectors, *bounds, *indices)


def result_space(moves: int, slacks: int) -> Result:
    """Memory for a result; with its count 0 the next solve begins cold."""
    n = moves + slacks
    return Result(np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros(n), np.zeros(1, dtype=np.int64))


OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}
"""Of the kernels: no exceptions, and no memory of numba's own, so that one that allocates does not compile."""


@njit(**OPTIONS)
def solve(p, result, limit, w):
    """Solve a problem, beginning with the active bounds that `result` holds.

    Args:
        p: Problem.
        result: Result; where to begin is overwritten with where it ends, also if that is no optimum.
        limit: Bounds to be added and dropped at most.
        w: Work.

    Returns:
        SOLVED, INFEASIBLE, EXHAUSTED or INVALID, and the number of iterations: 0 if the optimum without lines and
        slack is the optimum.
    """
    warm, slacks = result.count[0], p.price.shape[0]
    result.count[0] = 0
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


@njit(**OPTIONS)
def _eliminate(p, w):
    """Columns of J for the moves, and the optimum without lines; False if H is not positive or not finite.

    Elimination turns H = L D L' and -g into D and L^-1 (in place of the zeros) and into -L^-1 g; J = L^-T D^-1/2.
    """
    n, slacks, a, x, width = p.g.shape[0], p.price.shape[0], w.factor, w.x, w.factor.shape[1]
    for i in range(n):
        for j in range(n):
            a[i, j] = p.H[i, j]
        a[i, n] = -p.g[i]
    for k in range(n):
        if not a[k, k] > SINGULAR * p.H[k, k] or not a[k, k] < np.inf:
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
        for j in range(w.J.shape[1]):
            value = scale * a[i, j] if j <= i else 0.0
            w.J[slacks + i, j] = value
            x[j] += part * value
    return True


@njit(**OPTIONS)
def _load(p, w):
    """Lines that have a bound, as columns, and the variables, with their values; slack bounds active.

    Returns:
        How many there are of them, with padding; -1 if something is not finite or bounds cannot be kept.
    """
    n, slacks, lines = p.g.shape[0], p.price.shape[0], p.lower.shape[0]
    count, s = 0, 0
    for i in range(lines):
        while s < slacks and i >= p.ends[s]:
            w.edges[s] = count
            s += 1
        low, high = p.lower[i], p.upper[i]
        if not (low < np.inf and high > -np.inf):
            return -1
        w.place[i] = -1
        if low > -NO_BOUND or high < NO_BOUND:
            for q in range(n):
                w.columns[q, count] = p.G[i, q]
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
    total = rows + w.x.shape[0]
    _evaluate(p, total, w)
    _weigh(n, rows, w)
    finite = 0.0
    for i in range(rows):
        finite += 0.0 * w.value[i]
    return total if finite == 0.0 and _load_variables(p, rows, w) else -1


@njit(**OPTIONS)
def _weigh(n, rows, w):
    """Distances instead of violations: one over the length of the normals, whose slack part is in `excess`."""
    for q in range(n):
        for i in range(rows):
            w.excess[i] += w.columns[q, i] * w.columns[q, i]
    for i in range(rows):
        w.weight[i] = 1.0 / math.sqrt(w.excess[i] if w.excess[i] > 0.0 else 1.0)


@njit(**OPTIONS)
def _load_variables(p, rows, w):
    """Bounds of the variables, those of the slacks active; False if one is not finite or cannot be kept."""
    n, slacks, lines, finite = p.g.shape[0], p.price.shape[0], p.lower.shape[0], 0.0
    for q in range(w.x.shape[0]):
        _leave_empty(rows + q, w)
    for q in range(n):
        i = rows + q
        w.line[i], w.place[lines + q] = lines + q, i
        w.low[i], w.high[i], w.value[i] = p.x_lower[q], p.x_upper[q], w.x[q]
        finite += 0.0 * w.x[q]
        if not (w.low[i] <= w.high[i] and w.low[i] < np.inf and w.high[i] > -np.inf):
            return False
    for s in range(slacks):
        i = rows + n + s
        w.line[i], w.place[lines + n + s] = lines + n + s, i
        w.low[i], w.flags[i], w.active[s], w.u[s] = 0.0, LOWER, ~i, p.price[s]
        finite += 0.0 * p.price[s]
        if not (p.price[s] >= 0.0 and 0.0 < p.curvature[s] < np.inf):
            return False
    return finite == 0.0


@njit(**OPTIONS)
def _leave_empty(i, w):
    """A place that no bound has."""
    w.low[i], w.high[i], w.value[i], w.weight[i], w.excess[i], w.flags[i] = -np.inf, np.inf, 0.0, 1.0, 0.0, 0


@njit(**OPTIONS)
def _most_violated(p, total, w):
    """Bound with the largest violation, as distance: i if upper, ~i if lower; NONE if all are kept."""
    n, begin = p.g.shape[0], 0
    for s in range(p.price.shape[0] + 1):
        end, slack = (w.edges[s], w.x[n + s]) if s < p.price.shape[0] else (total, 0.0)
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


@njit(**OPTIONS)
def _begin(p, result, warm, total, w):
    """J and R of the slack bounds, then of the other bounds of an earlier solution; gives their count."""
    n, slacks, lines, variables = p.g.shape[0], p.price.shape[0], p.lower.shape[0], total - w.x.shape[0]
    if warm > 0:
        for s in range(slacks):
            w.flags[variables + n + s] = 0
        for c in range(min(warm, n + slacks)):
            s = -1 - result.active[c] - lines - n
            if 0 <= s < slacks:
                w.flags[variables + n + s] = LOWER
    count, last = 0, slacks
    for s in range(slacks):
        scale = 1.0 / math.sqrt(p.curvature[s])
        if w.flags[variables + n + s]:
            w.R[count, :] = 0.0
            w.R[count, count] = scale
            w.active[count], w.u[count] = ~(variables + n + s), p.price[s]
            column, count = count, count + 1
        else:
            w.x[n + s] = -p.price[s] / p.curvature[s]
            column = last = last - 1
        w.J[column, :] = 0.0
        w.J[column, n + s] = scale
    return count if warm == 0 else _add_earlier(p, result, warm, count, total, w)


@njit(**OPTIONS)
def _add_earlier(p, result, warm, count, total, w):
    n, slacks, lines = p.g.shape[0], p.price.shape[0], p.lower.shape[0]
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


@njit(**OPTIONS)
def _set_normal(p, code, total, w):
    """Normal of a bound, so that normal'x >= what is given back."""
    n, variables, sign = p.g.shape[0], total - w.x.shape[0], 1.0 if code < 0 else -1.0
    i = ~code if code < 0 else code
    w.normal[:] = 0.0
    if i >= variables:
        w.normal[i - variables] = sign
    else:
        for q in range(n):
            w.normal[q] = sign * w.columns[q, i]
        for s in range(p.price.shape[0]):
            if i < w.edges[s]:
                w.normal[n + s] = 1.0
                break
    return w.low[i] if code < 0 else -w.high[i]


@njit(**OPTIONS)
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
        for q in range(w.z.shape[0]):
            w.z[q] += value * w.J[j, q]
    return square, fresh


@njit(**OPTIONS)
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
    for q in range(w.z.shape[0]):
        w.z[q] = scale * (w.z[q] - pivot * w.J[count, q])
    for j in range(count, size):
        factor = w.along[j]
        for q in range(w.z.shape[0]):
            w.J[j, q] -= factor * w.z[q]
    w.active[count], w.u[count] = code, multiplier
    w.flags[~code if code < 0 else code] |= LOWER if code < 0 else UPPER


@njit(**OPTIONS)
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
        for q in range(w.z.shape[0]):
            a, b = w.J[c, q], w.J[c + 1, q]
            w.J[c, q], w.J[c + 1, q] = cosine * a + sine * b, cosine * b - sine * a


@njit(**OPTIONS)
def _solve_triangle(count, w):
    """r = R^-1 r."""
    for i in range(count - 1, -1, -1):
        value = w.r[i] / w.R[i, i]
        w.r[i] = value
        for j in range(i):
            w.r[j] -= value * w.R[i, j]


@njit(**OPTIONS)
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


@njit(**OPTIONS)
def _take_in(p, code, limit, iterations, total, count, w):
    """Raise the multiplier of a bound until it is kept, dropping those that reach 0 on the way."""
    size = p.g.shape[0] + p.price.shape[0]
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
            for q in range(w.z.shape[0]):
                w.step[q] += length * w.z[q]
        if full <= shortest:
            _add(size, count, fresh, code, multiplier, w)
            _advance(p, total, w)
            return SOLVED, iterations, count + 1
        _drop(count, blocking, w)
        count -= 1
        value = w.along[count]
        fresh += value * value
        for q in range(w.z.shape[0]):
            w.z[q] += value * w.J[count, q]
    return EXHAUSTED, iterations, count


@njit(**OPTIONS)
def _advance(p, total, w):
    """Move by `step`, values included."""
    variables = total - w.x.shape[0]
    for q in range(w.x.shape[0]):
        w.x[q] += w.step[q]
        w.value[variables + q] = w.x[q]
    for q in range(p.g.shape[0]):
        slope = w.step[q]
        for i in range(variables):
            w.value[i] += slope * w.columns[q, i]


@njit(**OPTIONS)
def _evaluate(p, total, w):
    """Values of all lines and variables, without what has gathered in rounding."""
    variables = total - w.x.shape[0]
    w.value[:variables] = 0.0
    for q in range(w.x.shape[0]):
        w.value[variables + q] = w.x[q]
    for q in range(p.g.shape[0]):
        slope = w.x[q]
        for i in range(variables):
            w.value[i] += slope * w.columns[q, i]


@njit(**OPTIONS)
def _settle(p, count, total, w):
    """One Newton step on the conditions of optimality with these active bounds: exact but for rounding."""
    n, size = p.g.shape[0], p.g.shape[0] + p.price.shape[0]
    for q in range(n):
        w.rhs[q] = p.g[q]
    for s in range(n, size):
        w.rhs[s] = p.price[s - n] + p.curvature[s - n] * w.x[s]
    for j in range(n):
        for q in range(n):
            w.rhs[q] += w.x[j] * p.H[j, q]
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


@njit(**OPTIONS)
def _hand_over(p, result, count, w):
    """Solution and active bounds, in the caller's numbers."""
    for q in range(result.x.shape[0]):
        result.x[q] = w.x[q]
    for c in range(count):
        code = w.active[c]
        result.active[c] = ~w.line[~code] if code < 0 else w.line[code]
        result.multipliers[c] = max(w.u[c], 0.0)
    result.count[0] = count
