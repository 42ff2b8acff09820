"""What the active set gets, gives back and works in."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

PADDING = 16
"""Arrays are padded to multiples of this: four vectors of four numbers."""


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
        size: How many bounds are active, shape (1,).
    """

    x: Array
    active: Indices
    multipliers: Array
    size: Indices


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
    squares = (
        np.zeros((moves, padded(moves + 1))),
        np.zeros((n, width)),
        np.zeros((n, width)),
        np.zeros((moves, rows)),
    )
    vectors, bounds = [np.zeros(width) for _ in range(8)], [np.zeros(rows + width) for _ in range(5)]
    indices = [np.zeros(size, dtype=np.int64) for size in (rows + width, lines + n, slacks, width, rows + width)]
    return Work._make([*squares, *vectors, *bounds, *indices])


def result_space(moves: int, slacks: int) -> Result:
    """Memory for a result; with its size 0 the next solve begins cold."""
    n = moves + slacks
    return Result(np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros(n), np.zeros(1, dtype=np.int64))
