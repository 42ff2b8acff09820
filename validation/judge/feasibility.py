"""Is there a way through? A label for a scene from a search that shares no code with the controller.

Reachability on a grid, depth first and layer by layer of time: the car is a box on a kinematic path whose curvature
changes at a bounded rate and whose lateral acceleration is bounded. Every grid cell (l, heading, curvature)
of a layer keeps the first state that reached it exactly as it got there, nothing is snapped to the grid. So a
"yes" always comes with a trajectory that was checked against the exact boxes and edges all along, a witness;
a "no" says that the grid found none. A stop counts if nothing hits the standing car afterwards, either.
"""

import math
from dataclasses import dataclass

import numpy as np

from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import Array, curvature_at, point_at
from sidestep.plant_models.road.widths import widths_at
from sidestep.plant_models.vehicle.parameters import GRAVITY
from sidestep.validation.judge.geometry import FAR, obstacle_poses
from sidestep.validation.scenarios.scenario import Scenario

MARGIN = 0.10
"""Distance of the witness from every obstacle and edge at least, in [m]."""
LATERAL_SHARE, BRAKING_SHARE, GRIP_SHARE = 0.7, 0.8, 0.9
"""Lateral acceleration and braking that the witness may use, as shares of mu g and of max_braking, and of the
friction circle together."""
STEER_SHARE, MAX_JERK = 0.7, 40.0
"""Share of the steering rate limit that the witness uses, and its lateral jerk at most, in [m/s^3]."""
REACTION_TIME = 0.3
"""Before the witness brakes, in [s]."""

LAYER, SUBSTEPS = 0.2, 6
"""Time between two decisions, in [s], and exact checks within it."""
_OFFSET_CELL, _HEADING_CELLS, _CURVATURE_CELLS = 0.2, 10, 6
_BUILD_UP = 1.2  # of the tightest curvature that is of use, in [s]
_MOVES = np.array([0.0, -0.5, 0.5, -1.0, 1.0])  # share of the curvature limit, on top of the road's
HORIZON = 20.0
"""Time at most until all is passed, and until which nothing hits the car after its stop, in [s]."""
BRAKE_LATER = np.arange(0.0, 6.0, 0.6)
"""Tried one after another on top of the reaction time, in [s]."""


@dataclass(frozen=True)
class Feasibility:
    """What physics allows in a scene.

    Attributes:
        passable: At constant speed there is a way past all obstacles.
        stoppable: There is a way to a standstill.
        witness: Rows of time [s], s, l [m], heading relative to the road [rad], path curvature [1/m], speed [m/s]
            of the way through if there is one, else of the stop; empty if there is neither.
    """

    passable: bool
    stoppable: bool
    witness: Array


def assess(scenario: Scenario) -> Feasibility:
    """Search for a way through, and for a stop, the earliest one first."""
    way = _search(scenario, math.inf, _time_to_pass(scenario))
    stops = (_search(scenario, start, HORIZON) for start in REACTION_TIME + BRAKE_LATER)
    stop = next((found for found in stops if len(found)), way[:0])
    return Feasibility(len(way) > 0, len(stop) > 0, way if len(way) else stop)


def _time_to_pass(scenario: Scenario) -> float:
    """Until the car, at its speed, has all obstacles behind it, and a second more, in [s]."""
    speed = scenario.start.v_x
    reach = scenario.vehicle.length
    times = [(o.s + o.length / 2.0 + reach) / max(speed - o.speed, 1e-3) for o in scenario.obstacles]
    if any(o.trajectory is not None for o in scenario.obstacles):
        return min(scenario.duration, HORIZON)
    return min(1.1 * max(times, default=0.0) + 1.0, HORIZON)


def _search(scenario: Scenario, brake_from: float, horizon: float) -> Array:
    vehicle, path = scenario.vehicle, scenario.path
    grip = scenario.plant.friction * GRAVITY
    braking = BRAKING_SHARE * min(vehicle.max_braking, grip)
    lateral = LATERAL_SHARE * grip
    lateral_braking = min(lateral, math.sqrt((GRIP_SHARE * grip) ** 2 - braking**2))
    speed = scenario.start.v_x
    layers = math.ceil(horizon / LAYER)
    times = LAYER / SUBSTEPS * np.arange(layers * SUBSTEPS + 1)
    speeds = np.clip(speed - braking * np.maximum(times - brake_from, 0.0), 0.0, None)
    limits = np.where(times > brake_from, lateral_braking, lateral)
    boxes = np.array([(o.s, o.l, o.length, o.width, o.heading, o.speed) for o in scenario.obstacles]).reshape(-1, 6)
    s, l, heading = path.project(scenario.start.x, scenario.start.y)  # noqa: E741
    start = np.array([s, l, scenario.start.yaw - heading])
    found, states = _depth_first(
        start, speeds, limits, _poses(path, scenario.obstacles, times), boxes, path.table, path.period,
        (vehicle.front_extent + MARGIN, vehicle.rear_extent + MARGIN, 0.5 * vehicle.width + MARGIN),
        path.edges.table, path.edges.spacing,
        STEER_SHARE * vehicle.steer_rate_limit / vehicle.wheelbase,
        layers,
    )  # fmt: skip
    if not found:
        return np.empty((0, 6))
    return np.column_stack([times, states, speeds]).astype(np.float64)


def _poses(path, obstacles, times):
    """World pose of every box at every time, shape (M, T, 3), and its station, which is the fourth column."""
    poses = np.empty((len(obstacles), len(times), 4))
    for m, obstacle in enumerate(obstacles):
        poses[m, :, :3] = obstacle_poses(path, obstacle, times).T
        poses[m, :, 3] = np.where(obstacle.is_there(times), obstacle.track(times)[0], FAR)
    return poses


@kernel
def _depth_first(start, speeds, limits, poses, boxes, table, period, car, edges, spacing, steering, layers):
    """The first trajectory through all layers.

    Args:
        start: s, l, heading.
        speeds, limits: Speed [m/s] and bound of lateral acceleration [m/s^2] at every substep.
        poses: See `_poses`.
        boxes: Rows of s, l, length, width, heading, speed.
        table, period: Of the path.
        car: Front, rear, half width with margin, in [m].
        edges, spacing: Table of the road's widths, see `Widths`.
        steering: Largest rate of curvature, in [1/(m s)].
        layers: Number of decisions.

    Returns:
        Whether there is one, and its s, l, heading, curvature at every substep.
    """
    trace = np.empty((layers * SUBSTEPS + 1, 4))
    trace[0, :3], trace[0, 3] = start, 0.0
    widest = min(0.7, 8.0 / max(speeds[0], 1.0))
    reach = (edges[:, 1].max(), edges[:, 0].max())
    cells = np.zeros((layers + 1, int((reach[0] + reach[1]) / _OFFSET_CELL) + 2,
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
        if not _advance(trace, at, move, speeds, limits, poses, boxes, table, period, car, edges, spacing, steering):
            continue
        _, l, heading, curvature = trace[at + SUBSTEPS]  # noqa: E741
        if abs(heading) > widest:
            continue
        limit = _curvature_limit(speeds[at + SUBSTEPS], limits[at + SUBSTEPS], steering)
        i = int((l + reach[0]) / _OFFSET_CELL)
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
def _advance(trace, at, move, speeds, limits, poses, boxes, table, period, car, edges, spacing, steering):
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
        if _leaves(l, heading, curvature_at(table, period, s), car, widths_at(edges, spacing, period, s)):
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
        if centre + car[2] * c > edges[0] or centre - car[2] * c < -edges[1]:
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
