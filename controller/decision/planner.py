"""Path search over a lattice of the road: costs (9)-(12) under (8), exact by layered dynamic programming."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.decision.corridor import Way, corridor_bounds, lateral_interval
from sidestep.controller.decision.costs import Lattice, node_costs
from sidestep.controller.decision.lattice import LATERAL_STEP, arrival_times, layer_spacing, shortest_path
from sidestep.controller.decision.moves import CREEP
from sidestep.controller.decision.narrow import NarrowWay, allowed_speeds
from sidestep.controller.decision.stopping import GRIP_SHARE
from sidestep.controller.decision.view import View
from sidestep.controller.records import LAYERS
from sidestep.plant_models.kernels import Array, Record, kernel
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

FREE, GAP_TOO_NARROW = -1, -2
PLANNER_REACH = 0.3
"""Stretch of road that the planner checks to both sides of a station, in lengths of the car."""

CURVATURE_SHARE, RATE_SHARE = 0.8, 0.7
"""Of the curvature at the steering's stop and of the wheels' rate, that a narrow way may ask for."""

WIDE = 1e3
"""Room that is no bound, in [m]."""


class PlannerSettings(NamedTuple):
    """What the search needs to know of car and configuration, see VehicleParameters and ControllerConfig.

    The body follows the path with its ends, so that each station of the path is checked for itself and
    `reach` to both sides of it, not for the whole length of a car that stands across its path.
    """

    front: float
    rear: float
    reach: float
    half_width: float
    buffer: float
    tightening: float
    margin_time: float
    safe_distance: float
    reference: float
    right_edge: float
    left_edge: float
    weight_reference: float
    weight_continuity: float
    weight_obstacle: float
    hysteresis: float
    max_lateral_speed: float
    max_slope: float
    acceleration: float
    braking: float
    comfort_braking: float
    least_clearance: float
    most_curvature: float
    turning: float

    @classmethod
    def of(cls, vehicle: VehicleParameters, c: ControllerConfig) -> "PlannerSettings":
        """For a car and a configuration."""
        return cls(
            front=vehicle.front_extent, rear=vehicle.rear_extent, reach=PLANNER_REACH * vehicle.length,
            half_width=0.5 * vehicle.width, buffer=c.buffer,
            tightening=c.tightening, margin_time=c.margin_time, safe_distance=c.safe_distance,
            reference=c.reference_offset, right_edge=-float(c.width_right), left_edge=float(c.width_left),
            weight_reference=c.weight_reference, weight_continuity=c.weight_continuity,
            weight_obstacle=c.weight_obstacle, hysteresis=c.side_hysteresis,
            max_lateral_speed=c.max_lateral_speed, max_slope=c.max_slope, acceleration=vehicle.max_acceleration,
            braking=min(vehicle.max_braking, GRIP_SHARE * c.friction * GRAVITY), comfort_braking=c.comfort_braking,
            least_clearance=min(c.least_clearance, c.buffer),
            most_curvature=CURVATURE_SHARE * math.tan(vehicle.steer_limit) / vehicle.wheelbase,
            turning=RATE_SHARE * vehicle.steer_rate_limit / vehicle.wheelbase,
        )  # fmt: skip


class PlannedPath(NamedTuple):
    """Result of the search.

    Attributes:
        stations: From the car on, relative to it, shape (S,), in [m].
        offsets: Planned l, shape (S,), in [m].
        right, left: Corridor (13) for the car's centre, shape (S,), in [m].
        sides: Passing side of each obstacle, +1 left of it, -1 right, 0 if the path runs into it or it is out of
            view, shape (M,).
        cost: Minimum of (9), summed.
        blocker: Index of the obstacle in the way that slows the car down most, or FREE or GAP_TOO_NARROW.
        room: Distance that the car can go before what is in the way, in [m].
        settled: Station from which on the car is back on the reference, relative to it, in [m].
        speeds, gaps: What the way itself allows [m/s] and leaves to both sides [m] at each station, shape (S,).
    """

    stations: NDArray[np.float64]
    offsets: NDArray[np.float64]
    right: NDArray[np.float64]
    left: NDArray[np.float64]
    sides: NDArray[np.int64]
    cost: float
    blocker: int
    room: float
    settled: float
    speeds: NDArray[np.float64]
    gaps: NDArray[np.float64]


class Start(NamedTuple):
    """Where the search begins.

    Attributes:
        station, offset: s and l of the car, in [m].
        speed, cruise: Present speed, and the one to go back to, in [m/s].
    """

    station: float
    offset: float
    speed: float
    cruise: float


@kernel
def _lateral_nodes(p):
    """Offsets of the nodes, counted from the reference so that the path can lie on it, and whether there are none."""
    hard = p.half_width + p.buffer
    lowest = math.ceil((p.right_edge + hard - p.reference) / LATERAL_STEP)
    highest = math.floor((p.left_edge - hard - p.reference) / LATERAL_STEP)
    narrow = lowest > highest
    if narrow:
        lowest = highest = round((0.5 * (p.right_edge + p.left_edge) - p.reference) / LATERAL_STEP)
    return p.reference + LATERAL_STEP * np.arange(lowest, highest + 1), lowest, narrow


@kernel
def _search(start, first, spacing, nodes, lowest, cost, p):
    """The lateral node of each layer, and the cost of all, under (8)."""
    pace, count = max(start.speed, 1.0), nodes.offsets.shape[0]
    begin = (start.offset - p.reference) / LATERAL_STEP - lowest
    slope = min(p.max_slope, p.max_lateral_speed / pace)
    reach = max(int(slope * spacing / LATERAL_STEP + 1e-9), 1)
    outside = max(-begin, begin - (count - 1), 0.0)
    begin_reach = max(slope * first / LATERAL_STEP, 1.0) + outside
    weight = p.weight_continuity * (LATERAL_STEP * pace) ** 2
    return shortest_path(cost, weight / first**2, weight / spacing**2, reach, begin, begin_reach, float(-lowest))


@kernel
def plan_path(start: Start, view: View, p: Record) -> PlannedPath:
    """Search the best path from the car on and the corridor around it.

    Args:
        start: Where the car is, and how fast.
        view: Obstacles relative to the car.
        p: PlannerSettings.
    """
    spacing = layer_spacing(start.speed)
    first = (math.floor(start.station / spacing + 1.5)) * spacing - start.station
    offsets, lowest, narrow = _lateral_nodes(p)
    stations = first + spacing * np.arange(LAYERS)
    times = arrival_times(stations, start.speed, start.cruise, p.acceleration)
    nodes = Lattice(stations, times, offsets)
    cost, settled = node_costs(nodes, max(start.speed, 1.0), view, p)
    chosen, least = _search(start, first, spacing, nodes, lowest, cost, p)

    path_stations, path_times, path = np.zeros(LAYERS + 1), np.zeros(LAYERS + 1), np.empty(LAYERS + 1)
    path_stations[1:], path_times[1:], path[0], path[1:] = stations, times, start.offset, offsets[chosen]
    sides, blocker, blocked_from = _passing_sides(path_stations, path_times, path, view, p)
    path[max(blocked_from, 1) :] = path[max(blocked_from, 1) - 1]  # stay where it is free until then
    right, left = corridor_along(path_stations, path_times, p.reach, view, sides, p)
    free = np.full(LAYERS + 1, np.inf)
    room = float(path_stations[max(min(blocked_from, LAYERS) - 1, 0)])
    if blocker < 0:
        squeezed = right > left + 1e-6
        for i in range(1, LAYERS + 1):
            # already squeezed at the start: beside it, not before it
            if narrow or (squeezed[i] and not squeezed[: i + 1].all()):
                blocker, room = GAP_TOO_NARROW, float(path_stations[i - 1])
                break
    return PlannedPath(
        path_stations, path, right, left, sides, least, blocker, room, settled, free, np.full(LAYERS + 1, WIDE)
    )


@kernel
def corridor_along(
    stations: Array, times: Array, reach: float, view: View, sides: NDArray[np.int64], p: Record
) -> tuple[Array, Array]:
    """Corridor (13) for the car's centre around a path.

    Args:
        stations, times: Of the path, shape (S,), in [m] and [s].
        reach: Stretch of road that counts to both sides of a station, in [m].
        view, sides: See `corridor_bounds`.
        p: PlannerSettings.

    Returns:
        right and left, shape (S,), in [m].
    """
    straight, hard = np.zeros(stations.shape[0]), p.half_width + p.buffer
    way = Way(stations, times, np.full(stations.shape[0], reach), straight, straight)
    right, left = corridor_bounds(way, view, sides, (p.right_edge, p.left_edge), 0.0)
    return right + hard, left - hard


@kernel
def around(way: NarrowWay, view: View, acceleration: float, p: Record) -> PlannedPath:
    """A narrow way as the path to follow.

    Args:
        way: Found.
        view: Obstacles relative to the car.
        acceleration: Lateral, that its bends may take, in [m/s^2].
        p: PlannerSettings.
    """
    times = way.stations / CREEP
    sides, _, _ = _passing_sides(way.stations, times, way.offsets, view, p)
    stations, offsets = way.stations[: LAYERS + 1], way.offsets[: LAYERS + 1]
    right, left = corridor_along(stations, times[: LAYERS + 1], 0.0, view, sides, p)
    speeds = allowed_speeds(way, acceleration, p)[: LAYERS + 1]
    return PlannedPath(stations, offsets, right, left, sides, 0.0, FREE, math.inf, 0.0, speeds, way.gaps[: LAYERS + 1])


@kernel
def _passing_sides(stations, times, path, view, p):
    """Side on which the path passes each obstacle, what slows the car down most, and from where on it is blocked."""
    polygons, speeds = view.polygons, view.speeds
    sides = np.zeros(polygons.shape[0], np.int64)
    blocker, least, blocked_from = FREE, math.inf, stations.shape[0]  # least speed that is allowed now
    reach = max(p.reach, 0.5 * (stations[2] - stations[1]))
    for m in range(polygons.shape[0]):
        begin, end = polygons[m, :, 0].min(), polygons[m, :, 0].max()
        middle = 0.5 * (polygons[m, 0, 1] + polygons[m, 4, 1])
        beside, hit, passing, distance = True, stations.shape[0], 0, math.inf
        for i in range(stations.shape[0]):
            shift = speeds[m] * times[i]
            away = abs(stations[i] - 0.5 * (begin + end) - shift)
            if away < distance:
                distance, passing = away, i
            gap = math.inf
            if begin + shift <= stations[i] + reach and end + shift >= stations[i] - reach:
                low, high = lateral_interval(polygons[m], shift, stations[i] - reach, stations[i] + reach)
                gap = max(low - path[i], path[i] - high)
            # within the buffer from the start on: beside it already, not blocked by it
            beside = beside and gap < p.half_width + p.buffer
            limit = p.half_width if beside else p.half_width + p.buffer
            if gap < limit - 0.5 * LATERAL_STEP:
                hit = min(hit, i)
        sides[m] = 1 if path[passing] >= middle else -1
        low, high = polygons[m, :, 1].min(), polygons[m, :, 1].max()
        if begin < p.front and end > -p.rear and not low < path[0] < high:
            sides[m] = 1 if path[0] >= high else -1  # beside it now, whatever the path would do
        elif hit < stations.shape[0] and low < path[passing] < high:
            sides[m] = 0  # straight into it: there is no side to keep
        if hit < stations.shape[0] and not (speeds[m] > 0.0 and end < p.front):  # waiting for what is behind is no help
            blocked_from = min(blocked_from, hit)
            room = max(begin, stations[hit] - reach) - p.front
            allowed = max(speeds[m], 0.0) + math.sqrt(2.0 * p.comfort_braking * max(room, 0.0))
            if allowed < least:
                blocker, least = m, allowed
    return sides, blocker, blocked_from
