"""Geometry of a path made of clothoid pieces: the numba kernels behind `ReferencePath`.

A path is a table with the columns s, x, y, heading, curvature, sharpness (curvature per metre). Row 0 is
the lead-in before s = 0, rows 1 to n are the pieces, row n + 1 is the run-out from s = length; every row
holds from its s to that of the next. `period` is the length of a closed path and 0 for an open one. With
`table` and `period` of a path these kernels can be called from any other numba kernel.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.kernels import kernel

Array = NDArray[np.float64]

MAX_CURVATURE = 1.0
"""Tightest curvature that a path may have, in [1/m]."""

MAX_LENGTH = 1e6
"""Longest path, in [m]."""

SPACING = 0.5
"""Longest piece, in [m]: none turns by more than half a radian."""

# Five Gauss points leave 1e-15 m on a piece that turns by up to half a radian.
_NODES, _WEIGHTS = (values / 2.0 for values in np.polynomial.legendre.leggauss(5))
_NODES += 0.5

_BLOCK = 16  # pieces that the search for the nearest point rules out at once


@kernel
def advance(heading: float, curvature: float, sharpness: float, u: float) -> tuple[float, float]:
    """Way (dx, dy) along a clothoid that starts with `heading` and `curvature`, after arc length `u`, in [m]."""
    dx = dy = 0.0
    for i in range(5):
        t = _NODES[i] * u
        angle = heading + t * (curvature + 0.5 * sharpness * t)
        dx += _WEIGHTS[i] * math.cos(angle)
        dy += _WEIGHTS[i] * math.sin(angle)
    return u * dx, u * dy


@kernel
def _row(table, s):
    low, high = 0, table.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle, 0] <= s:
            low = middle
        else:
            high = middle
    return low


@kernel
def curvature_at(table: Array, period: float, s: float) -> float:
    """Curvature at arc length `s` of any lap, in [1/m]; 0 outside an open path."""
    if period > 0.0:
        s -= np.floor(s / period) * period
    row = _row(table, s)
    return table[row, 4] + table[row, 5] * (s - table[row, 0])


@kernel
def pose_at(table: Array, period: float, s: float) -> tuple[float, float, float, float]:
    """Point, continuous heading and curvature at arc length `s`: x, y, heading, curvature in [m, m, rad, 1/m]."""
    turn = 0.0
    if period > 0.0:
        lap = np.floor(s / period)
        s -= lap * period
        turn = lap * (table[-1, 3] - table[1, 3])
    row = _row(table, s)
    u = s - table[row, 0]
    heading, curvature, sharpness = table[row, 3], table[row, 4], table[row, 5]
    dx, dy = advance(heading, curvature, sharpness, u)
    return (
        table[row, 1] + dx,
        table[row, 2] + dy,
        heading + turn + u * (curvature + 0.5 * sharpness * u),
        curvature + sharpness * u,
    )


@kernel
def point_at(table: Array, period: float, s: float, offset: float) -> tuple[float, float, float]:
    """World point beside the path, and the path's heading there: x, y, heading in [m, m, rad]."""
    x, y, heading, _ = pose_at(table, period, s)
    return x - offset * math.sin(heading), y + offset * math.cos(heading), heading


@kernel
def project_at(table: Array, period: float, x: float, y: float, near: float) -> tuple[float, float, float]:
    """Foot of the perpendicular from a point to the path.

    Args:
        table: The path's pieces.
        period: Its length if closed, else 0, in [m].
        x: The point's x, in [m].
        y: The point's y, in [m].
        near: Arc length from which to go downhill in distance, in [m]: stays on its branch. NaN asks
            for the nearest point of the whole path.

    Returns:
        s [m], l [m, left positive] and the path's heading there [rad]; NaN for a point that is not finite.
    """
    if not math.isfinite(x + y):
        return math.nan, math.nan, math.nan
    s = _downhill(table, period, x, y, near) if math.isfinite(near) else _nearest(table, period, x, y)
    _, offset, heading, _ = _seen_from(table, period, x, y, s)
    return s, offset, heading


@kernel
def _seen_from(table, period, x, y, s):
    """The point in the frame of the path at s: ahead, left; and the path's heading and curvature."""
    px, py, heading, curvature = pose_at(table, period, s)
    c, n = math.cos(heading), math.sin(heading)
    return (x - px) * c + (y - py) * n, (y - py) * c - (x - px) * n, heading, curvature


@kernel
def _ahead(table, row, x, y):
    heading = table[row, 3]
    return (x - table[row, 1]) * math.cos(heading) + (y - table[row, 2]) * math.sin(heading)


@kernel
def _distance(table, row, x, y):
    dx, dy = x - table[row, 1], y - table[row, 2]
    return math.sqrt(dx * dx + dy * dy)  # a third of the time of hypot


@kernel
def _foot(table, period, x, y, low, high):
    """Newton's method for the foot between two stations, bisection where it does not settle."""
    s = 0.5 * (low + high)
    for iteration in range(60):
        ahead, offset, _, curvature = _seen_from(table, period, x, y, s)
        if ahead > 0.0:
            low = s
        else:
            high = s
        slope = 1.0 - curvature * offset
        settles = slope > 0.0 and iteration < 10
        following = min(max(s + ahead / slope, low), high) if settles else 0.5 * (low + high)
        moved, s = abs(following - s), following
        if moved <= 1e-12 * (1.0 + abs(s)):
            break
    return s


@kernel
def _downhill(table, period, x, y, near):
    """Arc length of the foot in whose basin of attraction `near` lies."""
    count = table.shape[0] - 2
    lap = np.floor(near / period) if period > 0.0 else 0.0
    row = min(max(_row(table, near - lap * period), 1), count)
    distance = _distance(table, row, x, y)
    for step in (1, -1):
        while True:
            following, passed = row + step, 0
            if period > 0.0:
                passed = (following - 1) // count
                following -= passed * count
            elif not 1 <= following <= count + 1:
                break
            closer = _distance(table, following, x, y)
            if not closer < distance:
                break
            row, lap, distance = following, lap + passed, closer
    s, ahead = table[row, 0] + lap * period, _ahead(table, row, x, y)
    if period == 0.0 and ((row == 1 and ahead <= 0.0) or (row == count + 1 and ahead >= 0.0)):
        return s + ahead
    if ahead > 0.0:
        return _foot(table, period, x, y, s, s + table[row + 1, 0] - table[row, 0])
    previous = row - 1 if row > 1 else count
    return _foot(table, period, x, y, s - table[previous + 1, 0] + table[previous, 0], s)


@kernel
def _bound(table, start, end, x, y):
    """Lower bound, by the triangle inequality, of the distance to the path between two nodes."""
    way = table[end, 0] - table[start, 0]
    return 0.5 * (_distance(table, start, x, y) + _distance(table, end, x, y) - way)


@kernel
def _nearest(table, period, x, y):
    """Arc length of the nearest point: blocks, then pieces, that cannot hold it are skipped."""
    last = table.shape[0] - 1
    s, best = 0.0, math.inf
    for row in range(1, last, _BLOCK):
        distance = _distance(table, row, x, y)
        if distance < best:
            s, best = table[row, 0], distance
    for start in range(1, last, _BLOCK):
        end = min(start + _BLOCK, last)
        if _bound(table, start, end, x, y) >= best:
            continue
        for row in range(start, end):
            if _bound(table, row, row + 1, x, y) >= best:
                continue
            foot = _foot(table, 0.0, x, y, table[row, 0], table[row + 1, 0])
            ahead, offset, _, _ = _seen_from(table, 0.0, x, y, foot)
            distance = math.hypot(ahead, offset)
            if distance < best:
                s, best = foot, distance
    if period == 0.0 and not 1e-9 < s < table[last, 0] - 1e-9:
        s += _seen_from(table, 0.0, x, y, s)[0]
    return s


@kernel
def lay(table: Array, x: float, y: float, heading: float, pieces: Array) -> None:
    """Write the pieces one after another into a table, from a start pose on.

    Args:
        table: Shape (n + 2, 6), overwritten from row 1 on.
        x: Start point's x, in [m].
        y: Start point's y, in [m].
        heading: Heading of the start, in [rad].
        pieces: Length [m], curvature at the start [1/m] and sharpness [1/m^2] of each piece, shape (n, 3).
    """
    s = 0.0
    for i in range(pieces.shape[0]):
        length, curvature, sharpness = pieces[i]
        table[i + 1] = s, x, y, heading, curvature, sharpness
        dx, dy = advance(heading, curvature, sharpness, length)
        s, x, y = s + length, x + dx, y + dy
        heading += length * (curvature + 0.5 * sharpness * length)
    table[-1] = s, x, y, heading, 0.0, 0.0


@kernel
def fit(chord: float, start: float, end: float) -> tuple[float, float, float]:
    """The clothoid piece between two poses: length, curvature at the start, sharpness.

    Bertolazzi and Frego, G1 fitting with clothoids (2015): find the a = sharpness L^2 / 2 at which
    the way across the chord is zero; its derivative is close to -1/6 when the turn is small.

    Args:
        chord: Distance of the poses, in [m].
        start: Heading of the first relative to the chord, in [rad]; small.
        end: Heading of the second, likewise.
    """
    turn = end - start
    a = 3.0 * (start + end)
    for _ in range(20):
        across = advance(start, turn - a, 2.0 * a, 1.0)[1]
        a += 6.0 * across
    length = chord / advance(start, turn - a, 2.0 * a, 1.0)[0]
    return length, (turn - a) / length, 2.0 * a / length**2


def with_ends(table: Array, closed: bool) -> Array:
    """The table with lead-in and run-out written: straight on, or the other end's piece if closed."""
    first, last, end = table[1], table[-2], table[-1]
    table[0] = first
    table[0, 4:] = end[4:] = 0.0
    if closed:
        table[0, 4:] = last[4] + last[5] * (end[0] - last[0]), last[5]
        end[1:3], end[4:] = first[1:3], first[4:]
        end[3] = first[3] + math.tau * round((end[3] - first[3]) / math.tau)
    return table
