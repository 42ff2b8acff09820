"""Path search over a lattice of the road: costs (9)-(12) under (8), exact by layered dynamic programming."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.decision.corridor import corridor_bounds, lateral_interval
from sidestep.controller.decision.lattice import LATERAL_STEP, LAYERS, arrival_times, layer_spacing, shortest_path
from sidestep.controller.decision.stopping import GRIP_SHARE
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

FREE, GAP_TOO_NARROW = -1, -2
NEAR_COST, BLOCKED_COST, COLLISION_COST = 1e2, 1e4, 1e6
COMMITMENT_TIME, COMMITMENT = 2.5, 50.0
"""Time to reach an obstacle, in [s], from which on changing its side costs this many times more: nothing but a
blocked way is a reason then."""
APPROACH_SHARE, RETURN_SHARE = 0.03, 0.25
"""Share of cost (10) up to the last obstacle on the reference, as there is no use in returning to what must be left
again, and on the way back from there, which so takes its time."""
RETURN_TIME = 1.5
"""Time for the way back, in [s] per root of the way in [m]: the same lateral acceleration from any offset."""
FAR_SHARE = 1e-4
"""Share of the price of what a car that stops will not reach."""
PLANNER_REACH = 0.3
"""Stretch of road that the planner checks to both sides of a station, in lengths of the car."""


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


@kernel
def _way_back(last, speed, polygons, speeds, p):
    """Stations up to `last` where the car has passed what is on the reference, and where it is back on it, in [m]."""
    passed, settled = 0.0, 0.0
    for m in range(polygons.shape[0]):
        low, high = polygons[m, :, 1].min(), polygons[m, :, 1].max()
        aside = p.half_width + p.buffer + min(p.reference - low, high - p.reference)
        if aside > 0.5 * LATERAL_STEP and speed > speeds[m]:
            behind = speed / (speed - speeds[m]) * (polygons[m, :, 0].max() + p.rear)
            if behind < last:
                passed = max(passed, behind)
                settled = max(settled, behind + RETURN_TIME * math.sqrt(aside) * speed)
    return passed, settled


@kernel
def node_costs(stations, times, offsets, speed, polygons, speeds, committed, certain, p):
    """Costs (10) and (12) of every node, and the price of what is in the way.

    Args:
        stations, times: Layers [m] and when the car is there, from now [s], shape (S,).
        offsets: Lateral nodes, shape (L,), in [m].
        speed: Of the car, in [m/s].
        polygons, speeds: Obstacles, shapes (M, 8, 2) and (M,).
        committed: Passing side kept from before, 0 for none, shape (M,).
        certain: Stations beyond which the car may stop before it meets an obstacle, shape (M,), in [m].
        p: PlannerSettings.

    Returns:
        Shape (S, L); entries >= BLOCKED_COST lie within half width and buffer of an obstacle that is met. And the
        station from which on the car is back on the reference.
    """
    cost = np.zeros((stations.shape[0], offsets.shape[0]))
    passed, settled = _way_back(stations[-1], speed, polygons, speeds, p)
    half_step = 0.5 * LATERAL_STEP
    hard = p.half_width + p.buffer
    soft = hard + p.tightening + p.margin_time * speed
    for m in range(polygons.shape[0]):
        begin, end = polygons[m, :, 0].min(), polygons[m, :, 0].max()
        low_all, high_all = polygons[m, :, 1].min(), polygons[m, :, 1].max()
        near = begin - p.front < COMMITMENT_TIME * (speed - speeds[m])
        change = p.hysteresis * (COMMITMENT if near else 1.0)
        for i in range(stations.shape[0]):
            half_layer = 0.5 * (stations[min(i + 1, stations.shape[0] - 1)] - stations[max(i - 1, 0)]) * 0.5
            shift = speeds[m] * times[i]
            along = max(begin + shift - stations[i] - p.reach, stations[i] - p.reach - end - shift, 0.0)
            if along > p.safe_distance + half_layer:
                continue
            share = 1.0 if stations[i] <= certain[m] else FAR_SHARE
            reach = half_layer + p.reach
            low, high = lateral_interval(polygons[m], shift, stations[i] - reach, stations[i] + reach)
            inside = low <= high
            if not inside:
                low, high = low_all, high_all
            for j in range(offsets.shape[0]):
                gap = max(low - offsets[j], offsets[j] - high, 0.0)
                across = max(gap - soft, 0.0)
                if along * along + across * across < p.safe_distance**2:
                    distance = math.sqrt(along * along + across * across)
                    cost[i, j] += p.weight_obstacle * (p.safe_distance - distance) ** 2
                if inside:
                    if gap < soft:
                        cost[i, j] += NEAR_COST
                    if gap < hard - half_step:
                        cost[i, j] += share * BLOCKED_COST
                    if gap < p.half_width - half_step:
                        cost[i, j] += share * COLLISION_COST
                    if committed[m] * (offsets[j] - 0.5 * (low + high)) < 0.0:
                        cost[i, j] += change
    for i in range(stations.shape[0]):
        share = APPROACH_SHARE if stations[i] < passed else RETURN_SHARE if stations[i] < settled else 1.0
        for j in range(offsets.shape[0]):
            cost[i, j] += share * p.weight_reference * (offsets[j] - p.reference) ** 2
    return cost, settled


@kernel
def plan_path(station, offset, speed, cruise, polygons, speeds, committed, certain, p):
    """Search the best path from the car on and the corridor around it.

    Args:
        station, offset: s and l of the car, in [m].
        speed, cruise: Present speed, and the one to go back to, in [m/s].
        polygons, speeds: Obstacles relative to the car, shapes (M, 8, 2) and (M,), in [m] and [m/s].
        committed: Passing sides kept from the step before, 0 for none, shape (M,).
        certain: See `node_costs`.
        p: PlannerSettings.

    Returns:
        PlannedPath.
    """
    pace, spacing = max(speed, 1.0), layer_spacing(speed)
    first = (math.floor(station / spacing + 1.5)) * spacing - station
    stations = first + spacing * np.arange(LAYERS)
    hard = p.half_width + p.buffer
    # counted from the reference, so that the path can lie on it
    lowest = math.ceil((p.right_edge + hard - p.reference) / LATERAL_STEP)
    highest = math.floor((p.left_edge - hard - p.reference) / LATERAL_STEP)
    narrow = lowest > highest
    if narrow:
        lowest = highest = round((0.5 * (p.right_edge + p.left_edge) - p.reference) / LATERAL_STEP)
    offsets = p.reference + LATERAL_STEP * np.arange(lowest, highest + 1)

    times = arrival_times(stations, speed, cruise, p.acceleration)
    cost, settled = node_costs(stations, times, offsets, pace, polygons, speeds, committed, certain, p)
    start = (offset - p.reference) / LATERAL_STEP - lowest
    slope = min(p.max_slope, p.max_lateral_speed / pace)
    reach = max(int(slope * spacing / LATERAL_STEP + 1e-9), 1)
    outside = max(-start, start - (highest - lowest), 0.0)
    start_reach = max(slope * first / LATERAL_STEP, 1.0) + outside
    weight = p.weight_continuity * (LATERAL_STEP * pace) ** 2
    home = float(-lowest)
    nodes, least = shortest_path(cost, weight / first**2, weight / spacing**2, reach, start, start_reach, home)

    path_stations = np.empty(LAYERS + 1)
    path = np.empty(LAYERS + 1)
    path_stations[0], path[0] = 0.0, offset
    path_stations[1:], path[1:] = stations, offsets[nodes]
    path_times = np.zeros(LAYERS + 1)
    path_times[1:] = times
    sides, blocker, blocked_from = _passing_sides(path_stations, path_times, path, polygons, speeds, p)
    path[max(blocked_from, 1) :] = path[max(blocked_from, 1) - 1]  # stay where it is free until then
    right, left = corridor_bounds(
        path_stations, path_times, np.full(LAYERS + 1, p.reach), 0.0, np.zeros(LAYERS + 1), np.zeros(LAYERS + 1),
        polygons, speeds, sides, p.right_edge, p.left_edge,
    )  # fmt: skip
    right, left = right + hard, left - hard
    room = float(path_stations[max(min(blocked_from, LAYERS) - 1, 0)])
    if blocker < 0:
        squeezed = right > left + 1e-6
        for i in range(1, LAYERS + 1):
            # already squeezed at the start: beside it, not before it
            if narrow or (squeezed[i] and not squeezed[: i + 1].all()):
                blocker, room = GAP_TOO_NARROW, float(path_stations[i - 1])
                break
    return PlannedPath(path_stations, path, right, left, sides, least, blocker, room, settled)


@kernel
def _passing_sides(stations, times, path, polygons, speeds, p):
    """Side on which the path passes each obstacle, what slows the car down most, and from where on it is blocked."""
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
