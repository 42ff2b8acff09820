"""Planner and corridor of one control step in one kernel: what the MPC tracks and must stay within."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sidestep.controller.corridor import footprint_bounds, obstacle_polygons, path_reference
from sidestep.controller.planner import GAP_TOO_NARROW, PlannedPath, plan_path
from sidestep.plant_models.clothoid import curvature_at

Array = NDArray[np.float64]

SLOPE_TIME = 0.3
"""Half the time over which the path's slope is averaged, in [s]."""


class NodeGrid(NamedTuple):
    """Prediction nodes of the MPC and what the corridor asks there.

    Attributes:
        times, steps: From now, and length of the step that ends there, shape (N,), in [s].
        clearance: Half width, buffer and tightening, shape (N,), in [m].
        levers: Front and rear end of the footprint from the centre of gravity, in [m].
    """

    times: Array
    steps: Array
    clearance: Array
    levers: tuple[float, float]


class Corridor(NamedTuple):
    """Result of the kernel.

    Attributes:
        path: See PlannedPath.
        offset, slope: Path at the nodes, shape (N,), in [m] and [rad].
        turn_rate: Heading rate of the road at the nodes, shape (N,), in [rad/s].
        bounds: See `corridor.footprint_bounds`, shape (4, N), in [m].
        gap: Distance from the front bumper to what blocks the road, in [m]; infinite if nothing does.
        gap_speed: Speed of that along the road, in [m/s].
    """

    path: PlannedPath
    offset: Array
    slope: Array
    turn_rate: Array
    bounds: Array
    gap: float
    gap_speed: float


@njit(cache=True, nogil=True)
def plan_corridor(
    s, offset, speed, cruise, now, boxes, table, period, committed, settings, grid, times, states, age
):  # fmt: skip
    """Search the path and bound the footprint along the prediction.

    Args:
        s, offset: Of the car in the road frame, in [m].
        speed, cruise: v, and the speed to go back to, in [m/s].
        now: Time, in [s]; the boxes stand where they were at 0.
        boxes: See `corridor.obstacle_polygons`, but with absolute s, shape (M, 6).
        table, period: Of the ReferencePath.
        committed: Passing sides kept from the step before, shape (M,).
        settings: PlannerSettings.
        grid: NodeGrid.
        times, states, age: The last Prediction, whose yaw rate tells the curvature that the car will drive.

    Returns:
        The fields of `Corridor`, those of PlannedPath as a tuple.
    """
    boxes = boxes.copy()
    road = np.empty(boxes.shape[0])
    for m in range(boxes.shape[0]):
        ahead = boxes[m, 0] + boxes[m, 5] * now - s
        if period > 0.0:
            ahead -= period * round(ahead / period)
        boxes[m, 0] = ahead
        road[m] = curvature_at(table, period, s + ahead)
    polygons, speeds = obstacle_polygons(boxes, road), boxes[:, 5].copy()
    path = plan_path(s, offset, speed, cruise, polygons, speeds, committed, settings)
    path_stations, path_offsets, _, _, sides, _, blocker, room = path

    pace = max(speed, 0.0)
    stations = pace * grid.times
    curvature = np.empty(stations.shape[0])
    for k in range(stations.shape[0]):
        curvature[k] = curvature_at(table, period, s + stations[k])
    offsets, slope = path_reference(path_stations, path_offsets, stations, max(1.0, SLOPE_TIME * pace))
    bounds = footprint_bounds(
        stations, grid.times, 0.5 * pace * grid.steps + settings.buffer, grid.levers, grid.clearance,
        np.interp(grid.times, times - age, states[:, 3]) / max(speed, 1.0), curvature, polygons, speeds, sides,
        settings.right_edge, settings.left_edge,
    )  # fmt: skip
    gap, gap_speed = math.inf, 0.0
    if blocker >= 0:
        gap, gap_speed = polygons[blocker, :, 0].min() - settings.front, speeds[blocker]
    elif blocker == GAP_TOO_NARROW:
        gap = room
    return path, offsets, slope, pace * curvature, bounds, gap, gap_speed
