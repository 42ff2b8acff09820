"""A slow way through what stands close: least cost over offset and slope, for the oriented footprint as swept.

The search over the lattice bounds the path's slope, and gives every obstacle a share of the car's length. Here the
state is offset and slope, so that the path's curvature is one that the car can steer, and each move is checked with the
car's own outline, see `moves`. What that costs pays only where the lattice finds no way.
"""

import math
from typing import NamedTuple

import numpy as np

from sidestep.controller.decision.corridor import lateral_interval
from sidestep.controller.decision.lattice import LATERAL_STEP
from sidestep.controller.decision.moves import (
    CREEP,
    SLOPE_STEPS,
    SLOPES,
    Moves,
    fill_costs,
    half_taken,
    least_gaps,
    nearest_slope,
    outline,
    sheared_outlines,
)
from sidestep.controller.decision.view import View
from sidestep.controller.records import LAYERS
from sidestep.plant_models.kernels import Array, Record, kernel

SPACING = 0.8
"""Least distance between layers, in [m]: curvature 1 / 8 m where the slope changes by one step in one layer."""
FAR_LAYERS = 2 * LAYERS
CURVATURE_COST = 5.0
"""Of a change of slope by one step."""
ON_THE_WAY = 0.3
"""Distance [m] and angle [rad] from the last way up to which the car is on it."""
ROUNDED_LAYERS = 6
"""First layers in which the start's rounding to the grid is taken off what is asked for."""
NARROW_SHARE = 0.4
"""Of the hardest braking, that a way takes in each direction: both together are what the tyres give."""
WINDOW = 2
"""Layers before and after a station over which the way's curvature is taken."""
ALMOST_NONE = 1e-6
SLOWEST = 1.0
"""Least speed that a way may ask for, in [m/s]."""


class NarrowWay(NamedTuple):
    """Result of the search; all but `found` counts only if that is true.

    Attributes:
        found: Whether there is a way to the last layer.
        stations, offsets: The way, relative to the car's station, shape (FAR_LAYERS + 1,), in [m].
        slopes: Of the way up to each station, shape (FAR_LAYERS + 1,).
        gaps: Distance of the outline from obstacles and edges on the way to each station, at most what the planner asks
            for, shape (FAR_LAYERS + 1,), in [m].
    """

    found: bool
    stations: Array
    offsets: Array
    slopes: Array
    gaps: Array


@kernel
def plan_narrow(
    pose: tuple[float, float, float], speed: float, before: tuple[Array, Array], view: View, p: Record
) -> NarrowWay:
    """Search the way; from where the last one leads, as long as the car is on it, so that what was best stays best.

    Args:
        pose: Station and offset of the car [m], and the slope of its way.
        speed: Of the car, in [m/s].
        before: Stations and offsets of the last way, which may be empty, in [m].
        view: Obstacles relative to the car.
        p: PlannerSettings.
    """
    station, offset, slope = pose
    spacing = _spacing(p)
    unit = LATERAL_STEP / spacing
    first = (math.floor(station / spacing + 1.5)) * spacing - station
    stations = np.zeros(FAR_LAYERS + 1)
    stations[1:] = first + spacing * np.arange(FAR_LAYERS)
    offsets = _offsets(p)
    count = offsets.shape[0]
    sheared = sheared_outlines(view, unit)
    limits = least_gaps(view, sheared, slope, unit, offset, p)
    last, best = np.full((SLOPES, count), np.inf), np.empty((SLOPES, count))
    cost, turns = np.empty((SLOPES, count)), np.zeros((FAR_LAYERS + 1, SLOPES, count), np.int8)
    entry = _entry(pose, first, spacing, before)
    for i in range(1, FAR_LAYERS + 1):
        moves = Moves(stations[i - 1], stations[i], stations[i] / CREEP, unit, offsets)
        rounding = (0.5 * unit * max(p.front, p.rear) + 0.5 * LATERAL_STEP) * max(1.0 - (i - 1) / ROUNDED_LAYERS, 0.0)
        fill_costs(cost, moves, sheared, view, limits - rounding, speed, p)
        if i == 1:
            _begin(best, cost, (entry[0] - offsets[0]) / LATERAL_STEP, entry[1] / unit)
        else:
            number = round((station + stations[i]) / spacing)
            _advance(best, last, cost, turns[i], number % _layers_a_turn(stations[i], speed, unit / spacing, p) == 0)
        last, best = best, last
    way = _way_of(last, turns, stations, offsets, offset)
    if way.found:
        _measure(way, sheared, view, unit, p)
        return way
    return _kept(station, before, stations, sheared, view, p)


@kernel
def _spacing(p):
    """Of the layers, in [m]: one step of the slope in each is what the car can steer."""
    return max(SPACING, math.sqrt(LATERAL_STEP / p.most_curvature))


@kernel
def _offsets(p):
    hard = p.half_width + p.least_clearance
    lowest = math.ceil((p.right_edge + hard - p.reference) / LATERAL_STEP)
    highest = math.floor((p.left_edge - hard - p.reference) / LATERAL_STEP)
    return p.reference + LATERAL_STEP * np.arange(lowest, max(highest, lowest) + 1)


@kernel
def _kept(station, before, stations, sheared, view, p):
    """The last way, slowly, if it touches nothing: none that the car could find from beside it is no end to it."""
    way, count = np.zeros(FAR_LAYERS + 1), before[0].shape[0]
    if count == 0:
        return NarrowWay(False, stations, way, way, way)
    way, gaps = np.interp(station + stations, before[0], before[1]), np.zeros(FAR_LAYERS + 1)
    slopes = _slopes_of(stations, way)
    kept = NarrowWay(True, stations, way, slopes, gaps)
    _measure(kept, sheared, view, LATERAL_STEP / (stations[2] - stations[1]), p)
    known = int(np.searchsorted(stations, before[0][count - 1] - station))
    free = known > ROUNDED_LAYERS and gaps[:known].min() > 0.0
    gaps[:] = np.minimum(gaps, p.least_clearance)
    return NarrowWay(free, stations, way, slopes, gaps)


@kernel
def _slopes_of(stations, way):
    slopes = np.zeros(stations.shape[0])
    slopes[1:] = np.diff(way) / np.diff(stations)
    slopes[0] = slopes[1]
    return slopes


@kernel
def _entry(pose, first, spacing, before):
    """Offset at which the way comes to the first layer, and its slope there."""
    station, offset, slope = pose
    offset += slope * first
    if before[0].shape[0] > 0:
        there, kept = station + first, np.interp(station + first, before[0], before[1])
        led = (kept - np.interp(there - spacing, before[0], before[1])) / spacing
        if abs(kept - offset) < ON_THE_WAY and abs(led - slope) < ON_THE_WAY:
            return kept, led
    return offset, slope


@kernel
def _begin(best, cost, start, slope):
    """The first layer: nodes next to where the way leads."""
    best[:] = np.inf
    slope = min(max(slope, -float(SLOPE_STEPS)), float(SLOPE_STEPS))
    for k in (math.floor(slope), math.ceil(slope)):
        turn = k - slope
        for j in range(best.shape[1]):
            away = j - start - 0.5 * turn
            if abs(away) <= 1.0:
                row = int(k) + SLOPE_STEPS
                best[row, j] = cost[row, j] + CURVATURE_COST * (turn * turn + away * away)


@kernel
def _layers_a_turn(way, speed, curvature, p):
    """How many layers share a turn, so that its lateral acceleration is one that the car can have while it brakes."""
    braking = NARROW_SHARE * p.braking
    squared = max(speed * speed - 2.0 * braking * way, 0.0)
    return int(squared * curvature / braking) + 1


@kernel
def _advance(best, before, cost, turns, turnable):
    """One layer on: the least cost of each node and the turn that led to it."""
    count = best.shape[1]
    for k in range(SLOPES):
        step = k - SLOPE_STEPS
        low, high = max(step, 0), count + min(step, 0)
        best[k] = np.inf
        for turn in (0, -1, 1):
            source = k - turn
            if source < 0 or source >= SLOPES or (turn != 0 and not turnable):
                continue
            extra, here, chosen = CURVATURE_COST * turn * turn, best[k, low:high], turns[k, low:high]
            there = before[source, low - step : high - step]
            for j in range(high - low):
                value = there[j] + extra
                if value < here[j]:
                    here[j], chosen[j] = value, turn
        for j in range(count):
            best[k, j] += cost[k, j]


@kernel
def _way_of(last, turns, stations, offsets, offset):
    """The way back from the best node of the last layer."""
    way, slopes, gaps = np.empty(FAR_LAYERS + 1), np.zeros(FAR_LAYERS + 1), np.zeros(FAR_LAYERS + 1)
    row, j, least = 0, 0, math.inf
    for k in range(SLOPES):
        for i in range(last.shape[1]):
            if last[k, i] < least:
                row, j, least = k, i, last[k, i]
    unit = LATERAL_STEP / (stations[2] - stations[1])
    way[0] = offset
    if least < math.inf:
        for i in range(FAR_LAYERS, 0, -1):
            way[i], slopes[i] = offsets[j], (row - SLOPE_STEPS) * unit
            turn = turns[i, row, j]
            j, row = j - (row - SLOPE_STEPS), row - turn
    slopes[0] = slopes[1]
    return NarrowWay(least < math.inf, stations, way, slopes, gaps)


@kernel
def _measure(way, sheared, view, unit, p):
    """Fill the gaps."""
    for i in range(1, FAR_LAYERS + 1):
        slope, end = way.slopes[i], way.stations[i]
        row = nearest_slope(slope / unit) + SLOPE_STEPS
        front, rear, side = outline(slope, p)
        gap = min(way.offsets[i] - p.right_edge, p.left_edge - way.offsets[i]) - half_taken(slope, p)
        for m in range(view.speeds.shape[0]):
            shift = view.speeds[m] * end / CREEP
            low, high = lateral_interval(sheared[m, row], shift, way.stations[i - 1] - rear, end + front)
            if low <= high:
                raised = slope * (end - shift)
                gap = min(gap, max(low + raised - way.offsets[i], way.offsets[i] - high - raised) - side)
        way.gaps[i] = gap
    way.gaps[0] = way.gaps[1]


@kernel
def allowed_speeds(way: NarrowWay, acceleration: float, p: Record) -> Array:
    """Speed at each station by the way's own bends, by how fast the wheels turn, and by the room there, in [m/s].

    v^2 kappa <= a and v dkappa/ds <= the rate of the wheels over the wheelbase. The planner
    asks `margin_time` times the speed of room beyond the least; with none left the car creeps.

    Args:
        way: Found.
        acceleration: a, in [m/s^2].
        p: PlannerSettings.
    """
    bends = np.empty(FAR_LAYERS + 1)
    for i in range(FAR_LAYERS + 1):
        bends[i] = _mean_change(way.slopes, way.stations, i)
    speeds = np.empty(FAR_LAYERS + 1)
    for i in range(FAR_LAYERS + 1):
        turning = p.turning / max(abs(_mean_change(bends, way.stations, i)), ALMOST_NONE)
        bending = math.sqrt(acceleration / max(abs(bends[i]), ALMOST_NONE))
        speeds[i] = max(min(bending, turning, _speed_in_room(way.gaps[i], p)), SLOWEST)
    return speeds


@kernel
def _speed_in_room(gap, p):
    return CREEP + max(gap - p.least_clearance, 0.0) / max(p.margin_time, ALMOST_NONE)


@kernel
def is_narrow(way: NarrowWay, p: Record) -> bool:
    """Whether the way comes closer to something than the planner asks for, as far as a plan reaches."""
    return way.gaps[: LAYERS + 1].min() < p.buffer + p.tightening


@kernel
def _mean_change(values, stations, i):
    """Of values with the station, over the window about layer i."""
    begin, end = max(i - WINDOW, 0), min(i + WINDOW, FAR_LAYERS)
    return (values[end] - values[begin]) / (stations[end] - stations[begin])
