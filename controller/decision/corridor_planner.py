"""Planner and corridor of one control step in one kernel: what the MPC tracks and must stay within."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.decision.corridor import footprint_bounds, obstacle_polygons, path_reference
from sidestep.controller.decision.lattice import LATERAL_STEP, LAYERS, arrival_times, layer_spacing
from sidestep.controller.decision.planner import FREE, PlannedPath, plan_path
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import curvature_at
from sidestep.plant_models.vehicle.parameters import VehicleParameters

Array = NDArray[np.float64]

VIEW_TIME = 6.0
"""How far ahead in time obstacles are looked at at least, in [s]."""
VIEW_MARGIN = 10.0
"""Beyond the lattice and behind the car, in [m], up to which obstacles are looked at."""
VIEW_BEHIND = 3.0
"""How much longer they are looked at behind the car, in [s]: the way back lasts as long."""
BRAKING_DELAY = 0.1
"""Until the brakes act, in [s]."""
EASE, END_EASE = 0.03, 0.3
"""Share of the tracking costs before the car is back on the reference, where the corridor says enough and the way
is to be gentle, and their least share at the end of the horizon, which must not hang in the air."""
FULL_EASE_SPEED = 15.0
"""Speed from which on it is as gentle as that, in [m/s]; not at all below half of it, where nobody feels it."""
SLOPE_TIME = 0.3
"""Half the time over which the path's slope is averaged, in [s]."""
EDGE_TIME = 1.0
"""How long before what comes, and after, the road's edge is no reason to slow down, in [s]."""
TIGHTENING_TIME = 0.5
"""Time ahead from which on the full tightening is asked, in [s]."""


class NodeGrid(NamedTuple):
    """Prediction nodes of the MPC and what the corridor asks there.

    Attributes:
        times, steps: From now, and length of the step that ends there, shape (N,), in [s].
        clearance: Half width, buffer and tightening, shape (N,), in [m].
        levers: Front and rear end of the footprint from the centre of gravity, in [m].
        literal: Whether the car is v t ahead, as in the paper, though it goes across the road.
    """

    times: Array
    steps: Array
    clearance: Array
    levers: tuple[float, float]
    literal: bool = False

    @classmethod
    def of(cls, vehicle: VehicleParameters, c: ControllerConfig, times: Array) -> "NodeGrid":
        """The nodes of a configuration, at these times in [s]."""
        literal = c.formulation == "paper"  # bounds the centre point only, and by nothing more than (13)
        tightening = 0.0 if literal else c.tightening
        return cls(
            times=times, steps=np.diff(times, prepend=0.0),
            clearance=0.5 * vehicle.width + c.buffer + tightening * np.minimum(times / TIGHTENING_TIME, 1.0),
            levers=(0.0, 0.0) if literal else (vehicle.front_extent, -vehicle.rear_extent),
            literal=literal,
        )  # fmt: skip


class Corridor(NamedTuple):
    """Result of the kernel.

    Attributes:
        path: See PlannedPath.
        stations: Of the nodes, from the car on, shape (N,), in [m].
        offset, slope: Path at the nodes, shape (N,), in [m] and [rad].
        firmness: Share of the costs of leaving the path at the nodes, shape (N,).
        turn_rate: Heading rate of the road at the nodes, shape (N,), in [rad/s].
        bounds: See `corridor.footprint_bounds`, shape (4, N), in [m].
        heeded: The same without what comes, as slowing down does not get the car away from it, and without the road's
            edges from EDGE_TIME before that on, which may drive the car over them.
        gap: Distance that the front bumper may go to what blocks the road, in [m]; infinite if nothing does. Less than
            there is where the car must swing out again.
        gap_speed: Speed of that along the road, in [m/s]; 0 if it comes.
    """

    path: PlannedPath
    stations: Array
    offset: Array
    slope: Array
    firmness: Array
    turn_rate: Array
    bounds: Array
    heeded: Array
    gap: float
    gap_speed: float


@kernel
def _in_view(s, speed, cruise, now, boxes, period, settings):
    """Which boxes can be met on the way, and these with s from the car on, at present."""
    end = (LAYERS + 1) * layer_spacing(speed)
    until = max(arrival_times(np.array([end]), speed, cruise, settings.acceleration)[0], VIEW_TIME)
    begin = -settings.rear - VIEW_MARGIN - VIEW_BEHIND * max(speed, 0.0)
    near, ahead = np.empty(boxes.shape[0], np.int64), np.empty(boxes.shape[0])
    count = 0
    for m in range(boxes.shape[0]):
        now_at = boxes[m, 0] + boxes[m, 5] * now - s
        if period > 0.0:
            now_at -= period * round(now_at / period)
        reach, then_at = math.hypot(boxes[m, 2], boxes[m, 3]), now_at + boxes[m, 5] * until
        if max(now_at, then_at) + reach > begin and min(now_at, then_at) - reach < end + settings.front + VIEW_MARGIN:
            near[count], ahead[count] = m, now_at
            count += 1
    near = near[:count]
    boxes = boxes[near]
    boxes[:, 0] = ahead[:count]
    return near, boxes


@kernel
def _way_out(offset, lateral, speed, settings):
    """How far a car that is in an obstacle's lane drives until it can be out of it, in [m]; 0 if it cannot."""
    hard, pace = settings.half_width + settings.buffer, max(speed, 1.0)
    right, left = lateral.min() - hard, lateral.max() + hard
    aside = math.inf
    if right >= settings.right_edge + hard:
        aside = max(offset - right, 0.0)
    if left <= settings.left_edge - hard:
        aside = min(aside, max(left - offset, 0.0))
    if aside == math.inf:
        return 0.0
    spacing = layer_spacing(speed)
    slope = max(int(min(settings.max_slope, settings.max_lateral_speed / pace) * spacing / LATERAL_STEP + 1e-9), 1)
    return aside * spacing / (slope * LATERAL_STEP) + 2.0 * spacing + settings.reach


@kernel
def _coming(polygons, speeds, settings):
    """Which obstacles would run into a car that stands in their lane: oncoming ones, and those from behind."""
    coming = np.zeros(speeds.shape[0], np.bool_)
    for m in range(speeds.shape[0]):
        end = polygons[m, :, 0].max()
        coming[m] = end > -settings.rear if speeds[m] < 0.0 else speeds[m] > 0.0 and end < settings.front
    return coming


@kernel
def _plan(s, offset, speed, cruise, polygons, speeds, committed, held_up, settings):
    """The path; a car that is held up waits where what comes passes it.

    The slower it gets the farther away it would meet them, which makes a passing possible on paper that its
    own acceleration makes impossible again. So all of an obstacle's lane is taken that comes, from where the car can
    both have stopped and be out of it, or from the obstacle itself if it is nearer; and what stands beyond that counts
    for little, as the car will stop before it.
    """
    everywhere = np.full(speeds.shape[0], np.inf)
    coming = _coming(polygons, speeds, settings)
    if not (held_up and coming.any()):
        path = plan_path(s, offset, speed, cruise, polygons, speeds, committed, everywhere, settings)
        if path[6] == FREE or not coming.any():
            return path
    stop = max(speed, 0.0) * (BRAKING_DELAY + 0.5 * speed / settings.braking)
    swept, standing = polygons.copy(), np.maximum(speeds, 0.0)
    for m in range(speeds.shape[0]):
        if coming[m]:
            along, across = polygons[m, :, 0], polygons[m, :, 1]
            begin, end = max(stop, _way_out(offset, across, speed, settings)), along.max()
            if end > -settings.rear:
                begin = min(along.min(), begin)
            if speeds[m] > 0.0:
                end, standing[m] = max(begin, 0.0) + (LAYERS + 1) * layer_spacing(speed), 0.0
            middle, width = 0.5 * (across.min() + across.max()), across.max() - across.min()
            lane = np.array([[0.5 * (begin + end), middle, end - begin, width, 0.0, 0.0]])
            swept[m] = obstacle_polygons(lane, np.zeros(1))[0]
    path = plan_path(s, offset, speed, cruise, swept, standing, committed, everywhere, settings)
    if path[6] == FREE:
        return path
    certain = np.where(coming, np.inf, stop + settings.front)
    path = plan_path(s, offset, speed, cruise, swept, standing, committed, certain, settings)
    blocker = path[6]
    if blocker >= 0 and coming[blocker] and (speeds[blocker] > 0.0 or path[7] <= stop):  # it comes along the only way
        return plan_path(s, offset, speed, cruise, polygons, speeds, committed, everywhere, settings)
    return path


@kernel
def _room_to_leave(gap, pace, lateral, stations, offsets, settings):
    """The gap less what the car needs to swing out from behind an obstacle.

    It still brakes comfortably, and stops where it waits: not before it is out of the way.
    """
    wait, there = offsets[-1], 0.0
    for i in range(stations.shape[0]):
        if abs(offsets[i] - wait) > LATERAL_STEP:
            there = stations[i]
    aside = min(lateral.max() - wait, wait - lateral.min()) + settings.half_width + settings.buffer
    least = max(0.5 * pace * pace / settings.comfort_braking, there)
    return max(gap - max(aside, 0.0) / settings.max_slope, min(gap, least))


@kernel
def _gap(blocker, room, pace, stations, offsets, polygons, speeds, settings):
    """Fields gap and gap_speed of `Corridor`."""
    if blocker == FREE:
        return math.inf, 0.0
    coming = _coming(polygons, speeds, settings)
    if blocker < 0 or coming[blocker]:
        return room, 0.0
    gap = polygons[blocker, :, 0].min() - settings.front
    if coming.any():
        gap = _room_to_leave(gap, pace, polygons[blocker, :, 1], stations, offsets, settings)
    return gap, speeds[blocker]


@kernel
def _firmness(stations, settled, pace, gentle):
    """Field firmness of `Corridor`."""
    full = min(max(2.0 * pace / FULL_EASE_SPEED - 1.0, 0.0), 1.0) if gentle else 0.0
    firmness = np.where(stations < settled, EASE**full, 1.0)
    firmness[-1] = max(firmness[-1], END_EASE)
    return firmness


@kernel
def _stations_ahead(pace, steps, direction):
    """Stations of the nodes from the car on, in [m]: a car that goes across the road gets less far along it."""
    stations, station, before = np.empty(steps.shape[0]), 0.0, direction[0]
    for k in range(steps.shape[0]):
        station += pace * steps[k] * max(math.cos(0.5 * (before + direction[k])), 0.0)
        stations[k], before = station, direction[k]
    return stations


@kernel
def _bounds(way, sides, edges, settings, grid):
    stations, pace, direction, turn, curvature, polygons, speeds = way
    return footprint_bounds(
        stations, grid.times, 0.5 * pace * grid.steps, settings.buffer, grid.levers, grid.clearance, direction, turn,
        curvature, polygons, speeds, sides, *edges,
    )  # fmt: skip


@kernel
def plan_corridor(
    s, offset, speed, cruise, now, boxes, table, period, committed, held_up, gentle, settings, grid, times, states, age
):  # fmt: skip
    """Search the path and bound the footprint along the prediction.

    Args:
        s, offset: Of the car in the road frame, in [m].
        speed, cruise: v, and the speed to go back to, in [m/s].
        now: Time, in [s]; the boxes stand where they were at 0.
        boxes: See `corridor.obstacle_polygons`, but with absolute s, shape (M, 6).
        table, period: Of the ReferencePath.
        committed: Passing sides decided before, shape (M,).
        held_up: Whether the way was blocked in the step before.
        gentle: Whether the step before kept the corridor, so that there is room for comfort.
        settings: PlannerSettings.
        grid: NodeGrid.
        times, states, age: The last Prediction, which tells the direction and curvature that the car will drive.

    Returns:
        The fields of `Corridor`, those of PlannedPath as a tuple.
    """
    near, boxes = _in_view(s, speed, cruise, now, boxes, period, settings)
    road = np.empty(boxes.shape[0])
    for m in range(boxes.shape[0]):
        road[m] = curvature_at(table, period, s + boxes[m, 0])
    polygons, speeds = obstacle_polygons(boxes, road), boxes[:, 5].copy()
    path = _plan(s, offset, speed, cruise, polygons, speeds, committed[near], held_up, settings)
    path_stations, path_offsets, right, left, sides, cost, blocker, room, settled = path
    if blocker != FREE:  # stopping, not passing: no time to change sides, nor need to insist on one
        sides[sides * committed[near] < 0] = 0
    all_sides = np.zeros_like(committed)
    all_sides[near] = sides

    pace = max(speed, 0.0)
    direction = np.interp(grid.times, times - age, states[:, 1] + states[:, 2])
    stations = pace * grid.times if grid.literal else _stations_ahead(pace, grid.steps, direction)
    curvature = np.empty(stations.shape[0])
    for k in range(stations.shape[0]):
        curvature[k] = curvature_at(table, period, s + stations[k])
    offsets, slope = path_reference(path_stations, path_offsets, stations, max(1.0, SLOPE_TIME * pace))
    turn = np.interp(grid.times, times - age, states[:, 3]) / max(speed, 1.0)
    edges, coming = (settings.right_edge, settings.left_edge), _coming(polygons, speeds, settings)
    way = stations, pace, direction, turn, curvature, polygons, speeds
    bounds = _bounds(way, sides, edges, settings, grid)
    heeded = bounds
    if coming.any():
        others = np.where(coming, 0, sides)
        heeded = _bounds(way, others, edges, settings, grid)
        edgeless = _bounds(way, others, (-math.inf, math.inf), settings, grid)
        for k in range(stations.shape[0]):
            if (heeded[:, k] != bounds[:, k]).any():
                begin = np.searchsorted(grid.times, grid.times[k] - EDGE_TIME)
                heeded[:, begin:] = edgeless[:, begin:]
                break
    gap, gap_speed = _gap(blocker, room, pace, path_stations, path_offsets, polygons, speeds, settings)
    if blocker >= 0:
        all_sides[near[blocker]] = 0  # the car waits for it
    path = path_stations, path_offsets, right, left, all_sides, cost, blocker, room, settled
    firmness = _firmness(stations, settled, pace, gentle and blocker == FREE)
    return path, stations, offsets, slope, firmness, pace * curvature, bounds, heeded, gap, gap_speed
