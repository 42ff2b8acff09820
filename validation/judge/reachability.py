"""Reachability on a grid, depth first and layer by layer of time: the kernels of `feasibility`.

The car is a box on a kinematic path whose curvature changes at a bounded rate and whose lateral acceleration is
bounded. Every grid cell (l, heading, curvature) of a layer keeps the first state that reached it exactly as it got
there, nothing is snapped to the grid.
"""

import math

import numpy as np

from sidestep.plant_models.kernels import Array, kernel
from sidestep.plant_models.road.clothoid import curvature_at, point_at

MAX_JERK = 40.0
"""Lateral jerk of the witness at most, in [m/s^3]."""

LAYER, SUBSTEPS = 0.2, 6
"""Time between two decisions, in [s], and exact checks within it."""
_OFFSET_CELL, _HEADING_CELLS, _CURVATURE_CELLS = 0.2, 10, 6
_BUILD_UP = 1.2  # of the tightest curvature that is of use, in [s]
_MOVES = np.array([0.0, -0.5, 0.5, -1.0, 1.0])  # share of the curvature limit, on top of the road's


@kernel
def depth_first(
    start: Array,
    speeds: Array,
    limits: Array,
    poses: Array,
    boxes: Array,
    table: Array,
    period: float,
    car: tuple[float, float, float],
    edges: tuple[float, float],
    steering: float,
    layers: int,
) -> tuple[bool, Array]:
    """The first trajectory through all layers.

    Args:
        start: s, l, heading.
        speeds, limits: Speed [m/s] and bound of lateral acceleration [m/s^2] at every substep.
        poses: See `_poses`.
        boxes: Rows of s, l, length, width, heading, speed.
        table, period: Of the path.
        car: Front, rear, half width with margin, in [m].
        edges: Right, left, in [m].
        steering: Largest rate of curvature, in [1/(m s)].
        layers: Number of decisions.

    Returns:
        Whether there is one, and its s, l, heading, curvature at every substep.
    """
    trace = np.empty((layers * SUBSTEPS + 1, 4))
    trace[0, :3], trace[0, 3] = start, 0.0
    widest = min(0.7, 8.0 / max(speeds.max(), 1.0))
    cells = np.zeros((layers + 1, int((edges[1] - edges[0]) / _OFFSET_CELL) + 2,
                      2 * _HEADING_CELLS + 1, 2 * _CURVATURE_CELLS + 1), np.uint8)  # fmt: skip
    tried = np.zeros(layers + 1, np.int64)
    layer = 0
    while layer < layers:
        if tried[layer] == _MOVES.shape[0]:
            tried[layer] = 0
            layer -= 1
            if layer < 0:
                return False, trace
            continue
        move = _MOVES[tried[layer]]
        tried[layer] += 1
        at = layer * SUBSTEPS
        if not _advance(trace, at, move, speeds, limits, poses, boxes, table, period, car, edges, steering):
            continue
        _, l, heading, curvature = trace[at + SUBSTEPS]  # noqa: E741
        if abs(heading) > widest:
            continue
        limit = _curvature_limit(speeds[at + SUBSTEPS], limits[at + SUBSTEPS], steering)
        i = int((l - edges[0]) / _OFFSET_CELL)
        j = _HEADING_CELLS + round(heading / widest * _HEADING_CELLS)
        k = _CURVATURE_CELLS + round(curvature / limit * _CURVATURE_CELLS)
        if cells[layer + 1, i, j, k]:
            continue
        cells[layer + 1, i, j, k] = 1
        layer += 1
    return True, trace


@kernel
def _curvature_limit(speed, acceleration, steering):
    return min(acceleration / max(speed, 1.0) ** 2, _BUILD_UP * steering)


@kernel
def _advance(trace, at, move, speeds, limits, poses, boxes, table, period, car, edges, steering):
    """Drive one layer towards a curvature; false as soon as something is touched or the bound would break."""
    s, l, heading, curvature = trace[at]  # noqa: E741
    h = LAYER / SUBSTEPS
    for i in range(at, at + SUBSTEPS):
        v = 0.5 * (speeds[i] + speeds[i + 1])
        limit = _curvature_limit(speeds[i], limits[i + 1], steering)
        road = curvature_at(table, period, s)
        aim = min(max(road + move * limit, -limit), limit)
        rate = min(steering, MAX_JERK / max(v, 1.0) ** 2)
        bent = curvature + min(max(aim - curvature, -rate * h), rate * h)
        if abs(bent) > limit * (1.0 + 1e-9):
            return False
        turn = v * 0.5 * (curvature + bent)
        along = v * math.cos(heading) / (1.0 - road * l)
        middle = heading + 0.5 * h * (turn - road * along)
        half = l + 0.5 * h * v * math.sin(heading)
        road = curvature_at(table, period, s + 0.5 * h * along)
        along = v * math.cos(middle) / (1.0 - road * half)
        s, l = s + h * along, l + h * v * math.sin(middle)  # noqa: E741
        heading, curvature = heading + h * (turn - road * along), bent
        trace[i + 1] = s, l, heading, curvature
        if _leaves(l, heading, curvature_at(table, period, s), car, edges):
            return False
        for m in range(boxes.shape[0]):
            if _hits(s, l, heading, poses[m, i + 1], boxes[m], table, period, car):
                return False
    return True


@kernel
def _leaves(l, heading, road, car, edges):  # noqa: E741
    """Whether a corner is over an edge; exact to second order of the road's curvature."""
    c, d = math.cos(heading), math.sin(heading)
    for lever in (car[0], -car[1]):
        centre = l + lever * d - 0.5 * road * lever * lever
        if centre + car[2] * c > edges[1] or centre - car[2] * c < edges[0]:
            return True
    return False


@kernel
def _hits(s, l, heading, pose, box, table, period, car):  # noqa: E741
    """Whether the car's rectangle overlaps a box in the world: exact, by separating axes."""
    if abs(pose[3] - s) > box[2] + box[3] + 2.0 * (car[0] + car[1]):
        return False
    x, y, road = point_at(table, period, s, l)
    yaw = road + heading
    c, d = math.cos(yaw), math.sin(yaw)
    long, wide = 0.5 * (car[0] + car[1]), car[2]
    offset = 0.5 * (car[0] - car[1])
    dx, dy = pose[0] - x - offset * c, pose[1] - y - offset * d
    a, b = 0.5 * box[2], 0.5 * box[3]
    turn_c, turn_d = abs(math.cos(pose[2] - yaw)), abs(math.sin(pose[2] - yaw))
    if abs(dx * c + dy * d) > long + a * turn_c + b * turn_d:
        return False
    if abs(dy * c - dx * d) > wide + a * turn_d + b * turn_c:
        return False
    c, d = math.cos(pose[2]), math.sin(pose[2])
    if abs(dx * c + dy * d) > a + long * turn_c + wide * turn_d:
        return False
    return abs(dy * c - dx * d) <= b + long * turn_d + wide * turn_c
