"""Exact lateral intervals of obstacles, and the corridor (13) made of them.

Stations are relative to the car's s. An obstacle is a convex polygon of eight road-frame points
(corners and edge middles), so that a box stays a box on a curved road to second order.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.decision.view import View
from sidestep.plant_models.kernels import Array, Record, kernel

FIRST_CORRIDOR_TIME = 0.1
"""Earlier nodes get no corridor rows, in [s]: steering cannot move the car by a millimetre by then."""
NOTICED = 0.01
"""Excess over the corridor that counts as one, in [m]."""


@kernel
def obstacle_polygons(boxes: Array, curvature: Array) -> Array:
    """Outline of boxes in the road frame.

    Args:
        boxes: Rows of s (relative), l, length, width, heading, speed, shape (M, 6), in [m, rad, m/s].
        curvature: Of the road at each box, shape (M,), in [1/m].

    Returns:
        Polygons, shape (M, 8, 2): s and l of corners and edge middles, counter-clockwise, in [m].
    """
    polygons = np.empty((boxes.shape[0], 8, 2))
    for m in range(boxes.shape[0]):
        s, l, length, width, heading, _ = boxes[m]  # noqa: E741
        c, d = math.cos(heading), math.sin(heading)
        for i in range(8):
            a = 0.5 * length * (1.0 if i in (0, 1, 7) else (0.0 if i in (2, 6) else -1.0))
            b = 0.5 * width * (1.0 if i in (1, 2, 3) else (0.0 if i in (0, 4) else -1.0))
            along, across = c * a - d * b, d * a + c * b
            shrink = max(1.0 - curvature[m] * (l + across), 0.1)
            polygons[m, i, 0] = s + along / shrink
            polygons[m, i, 1] = l + across - 0.5 * curvature[m] * along * along / shrink
    return polygons


@kernel
def lateral_interval(polygon: Array, shift: float, start: float, end: float) -> tuple[float, float]:
    """Smallest and largest l of a polygon between two stations.

    Args:
        polygon: Shape (8, 2), in [m].
        shift: Added to the polygon's s, in [m].
        start, end: Stations, in [m].

    Returns:
        low, high in [m]; low > high if the polygon lies elsewhere.
    """
    low, high = math.inf, -math.inf
    for i in range(8):
        s0, l0 = polygon[i, 0] + shift, polygon[i, 1]
        s1, l1 = polygon[(i + 1) % 8, 0] + shift, polygon[(i + 1) % 8, 1]
        if max(s0, s1) < start or min(s0, s1) > end:
            continue
        for station in (max(min(s0, s1), start), min(max(s0, s1), end)):
            t = (station - s0) / (s1 - s0) if s1 != s0 else 0.0
            value = l0 + (l1 - l0) * t
            low, high = min(low, value), max(high, value)
            if s1 == s0:
                low, high = min(low, l1), max(high, l1)
    return low, high


class Way(NamedTuple):
    """Queries along a path, each of shape (N,).

    Attributes:
        stations, times: Centre of each query, in [m], and when the car is there, from now, in [s].
        reach: The query covers stations -+ reach, in [m].
        direction, bend: Of the car's path there and its curvature, both against the road, in [rad] and [1/m]: an
            obstacle that begins or ends within the reach bounds the car where it does, and that bound is carried to the
            station along the path.
    """

    stations: Array
    times: Array
    reach: Array
    direction: Array
    bend: Array


class Motion(NamedTuple):
    """How the car will move, each of shape (N,).

    Attributes:
        stations, times, reach, direction: See `Way`, of the centre of gravity.
        turn: Curvature of the predicted path gamma / v, in [1/m].
        curvature: Of the road at the stations, in [1/m].
    """

    stations: Array
    times: Array
    reach: Array
    direction: Array
    turn: Array
    curvature: Array


class Outline(NamedTuple):
    """What the car's outline takes.

    Attributes:
        levers: Front end (positive) and rear end (negative) from the centre of gravity, shape (2,), in [m].
        clearance: To stay free to each side at every node, half width and buffer, shape (N,), in [m].
    """

    levers: Array
    clearance: Array


@kernel
def corridor_bounds(
    way: Way, view: View, sides: NDArray[np.int64], edges: tuple[float, float], buffer: float
) -> tuple[Array, Array]:
    """Free lateral interval at stations, Eq. (13) without the half width and buffer.

    Args:
        way: Where it is asked for.
        view: Obstacles.
        sides: +1 where the car passes on the obstacle's left, -1 on its right, 0 ignores it; shape (M,).
        edges: Right and left edge of the road as l, in [m].
        buffer: Added to obstacles at both ends, in [m].

    Returns:
        right and left boundary, each of shape (N,), in [m].
    """
    stations, reach = way.stations, way.reach
    right, left = np.full(stations.shape[0], edges[0]), np.full(stations.shape[0], edges[1])
    for m in range(sides.shape[0]):
        if sides[m] == 0:
            continue
        polygon = view.polygons[m]
        begin, end = polygon[:, 0].min() - buffer, polygon[:, 0].max() + buffer
        for k in range(stations.shape[0]):
            shift = view.speeds[m] * way.times[k]
            away = max(begin + shift - stations[k], 0.0) + min(end + shift - stations[k], 0.0)
            if abs(away) > reach[k]:
                continue
            wide = reach[k] + buffer
            low, high = lateral_interval(polygon, shift, stations[k] - wide, stations[k] + wide)
            carried = (way.direction[k] + 0.5 * way.bend[k] * away) * away
            if sides[m] > 0:
                right[k] = max(right[k], high - carried)
            else:
                left[k] = min(left[k], low - carried)
    return right, left


@kernel
def footprint_bounds(
    motion: Motion, view: View, sides: NDArray[np.int64], edges: tuple[float, float], buffer: float, outline: Outline
) -> Array:
    """Bounds on l + lever e_phi of the car's centre line at two ends of its footprint, Eq. (13).

    Where a box corner slides along the turning car between its ends it comes closer by up to
    turn (front + rear)^2 / 8 on the inner side; the bounds there are tightened by that much.

    Args:
        motion: Of the car.
        view, sides, edges, buffer: See `corridor_bounds`.
        outline: What is to stay free.

    Returns:
        right and left at the front, right and left at the rear, shape (4, N), in [m].
    """
    n, levers, clearance = motion.stations.shape[0], outline.levers, outline.clearance
    bounds, bend = np.empty((4, n)), motion.turn - motion.curvature
    for end in range(2):
        lever = levers[end]
        way = Way(motion.stations + lever, motion.times, motion.reach, motion.direction + lever * bend, bend)
        right, left = corridor_bounds(way, view, sides, edges, buffer)
        for k in range(n):
            inner = motion.turn[k] * (levers[0] - levers[1]) ** 2 / 8.0
            bow = 0.5 * motion.curvature[k] * lever * lever
            low = right[k] + clearance[k] + max(-inner, 0.0) + bow
            high = left[k] - clearance[k] - max(inner, 0.0) + bow
            if low > high:
                low = high = 0.5 * (low + high)
            bounds[2 * end, k], bounds[2 * end + 1, k] = low, high
    return bounds


@kernel
def excess_over(w: Record, grid: Record) -> tuple[float, float]:
    """How far a prediction leaves its corridor.

    Args:
        w: Work space: `slowing_bounds` bounds, see `footprint_bounds`, and `states`.
        grid: Record of `GRID`.

    Returns:
        Largest excess from FIRST_CORRIDOR_TIME on, in [m], and when it first comes to a centimetre, in [s];
        infinite if never.
    """
    worst, first = 0.0, math.inf
    for k in range(grid.nodes):
        if grid.times[k] < FIRST_CORRIDOR_TIME:
            continue
        for end in range(2):
            value = w.states[k + 1, 0] + grid.levers[end] * w.states[k + 1, 1]
            excess = max(w.slowing_bounds[2 * end, k] - value, value - w.slowing_bounds[2 * end + 1, k])
            worst = max(worst, excess)
            if excess > NOTICED:
                first = min(first, grid.times[k])
    return worst, first


@kernel
def path_reference(stations: Array, offsets: Array, queries: Array, span: float) -> tuple[Array, Array]:
    """Offset of the planned path and its mean slope over -+ span.

    Args:
        stations, offsets: The path, shape (S,), in [m].
        queries: Stations, shape (N,), in [m].
        span: In [m].

    Returns:
        Offsets [m] and slopes [rad], each of shape (N,).
    """
    offset = np.interp(queries, stations, offsets)
    slope = (np.interp(queries + span, stations, offsets) - np.interp(queries - span, stations, offsets)) / (2.0 * span)
    return offset, slope
