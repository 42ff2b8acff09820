"""J and R: P = J^-T J^-1 and J'N = [R; 0] with N the normals of the active bounds."""

import math

import numpy as np

from sidestep.controller.mpc.active_set.lines import LOWER, UPPER, set_normal
from sidestep.plant_models.kernels import Record, bare_kernel

SINGULAR = 1e-14
"""P counts as singular if a pivot is this share of its diagonal or less."""


@bare_kernel
def eliminate(p: Record, w: Record) -> bool:
    """Columns of J for the moves, and the optimum without lines; False if P is not positive or not finite.

    Elimination turns P = L D L' and -q into D and L^-1 (in place of the zeros) and into -L^-1 q; J = L^-T D^-1/2.
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


@bare_kernel
def project(size: int, count: int, w: Record) -> tuple[float, float]:
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


@bare_kernel
def add(size: int, count: int, fresh: float, code: int, multiplier: float, w: Record) -> None:
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
    w.held[~code if code < 0 else code] |= LOWER if code < 0 else UPPER


@bare_kernel
def drop(count: int, place: int, w: Record) -> None:
    """Take an active bound out, by rotations that make R triangular again."""
    code = w.active[place]
    w.held[~code if code < 0 else code] &= ~(LOWER if code < 0 else UPPER)
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


@bare_kernel
def solve_triangle(count: int, w: Record) -> None:
    """Make r of R^-1 r."""
    for i in range(count - 1, -1, -1):
        value = w.r[i] / w.R[i, i]
        w.r[i] = value
        for j in range(i):
            w.r[j] -= value * w.R[i, j]


@bare_kernel
def settle(p: Record, count: int, total: int, w: Record) -> None:
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
        missing = set_normal(p, w.active[c], total, w)
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
    solve_triangle(count, w)
    for c in range(count):
        w.u[c] += w.r[c]
    for j in range(size):
        for q in range(size):
            w.x[q] += w.z[j] * w.J[j, q]
