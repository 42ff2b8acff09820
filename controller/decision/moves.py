"""What a move of the narrow way costs: the car's outline, swept from one layer to the next, beside obstacles and edges.

In coordinates sheared by the move's slope the outline is a box along the road which only slides, so the check is exact.
"""

import math
from typing import NamedTuple

import numpy as np

from sidestep.controller.decision.corridor import lateral_interval
from sidestep.controller.decision.costs import NEAR_COST, RETURN_SHARE, change_of_side
from sidestep.controller.decision.lattice import LATERAL_STEP
from sidestep.controller.decision.view import View
from sidestep.plant_models.kernels import Array, Record, kernel

SLOPE_STEPS = 5
"""Slopes to both sides, in lateral steps a layer."""
SLOPES = 2 * SLOPE_STEPS + 1
CREEP = 3.0
"""Speed at which what moves is met, and that is left where there is no more room than the least, in [m/s]."""


class Moves(NamedTuple):
    """Where the moves of a layer begin and end [m], when [s], the unit of their slopes, and the offsets (L,) [m]."""

    begin: float
    end: float
    time: float
    unit: float
    offsets: Array


@kernel
def sheared_outlines(view: View, unit: float) -> Array:
    """Obstacles' outlines with l - slope s in place of l, for each slope in `unit`, shape (M, SLOPES, 8, 2), in [m]."""
    count = view.speeds.shape[0]
    sheared = np.empty((count, SLOPES, 8, 2))
    for m in range(count):
        for k in range(SLOPES):
            for i in range(8):
                s = view.polygons[m, i, 0]
                sheared[m, k, i, 0], sheared[m, k, i, 1] = s, view.polygons[m, i, 1] - (k - SLOPE_STEPS) * unit * s
    return sheared


@kernel
def outline(slope: float, p: Record) -> tuple[float, float, float]:
    """How far the outline of a car on a way of this slope reaches to the front, to the rear and to a side, in [m]."""
    c = 1.0 / math.sqrt(1.0 + slope * slope)
    corner = p.half_width * abs(slope) * c
    return p.front * c + corner, p.rear * c + corner, p.half_width / c


@kernel
def half_taken(slope: float, p: Record) -> float:
    """What the outline takes of the road to a side, corners and all, in [m]."""
    return (max(p.front, p.rear) * abs(slope) + p.half_width) / math.sqrt(1.0 + slope * slope)


@kernel
def nearest_slope(steps: float) -> int:
    """Number of the slope that is nearest to so many steps, 0 for straight on."""
    return min(max(round(steps), -SLOPE_STEPS), SLOPE_STEPS)


@kernel
def least_gaps(view: View, sheared: Array, slope: float, unit: float, offset: float, p: Record) -> Array:
    """Least distance to each obstacle: what is asked for, or what there is at the start if that is less."""
    limits = np.full(view.speeds.shape[0], p.least_clearance)
    k = nearest_slope(slope / unit)
    front, rear, side = outline(k * unit, p)
    for m in range(limits.shape[0]):
        low, high = lateral_interval(sheared[m, k + SLOPE_STEPS], 0.0, -rear, front)
        if low <= high:
            limits[m] = min(limits[m], max(low - offset, offset - high) - side - 0.5 * LATERAL_STEP)
    return limits


@kernel
def fill_costs(cost: Array, moves: Moves, sheared: Array, view: View, limits: Array, speed: float, p: Record) -> None:
    """What each move costs that ends at a node, into `cost`, shape (SLOPES, L); infinite where it touches."""
    for j in range(moves.offsets.shape[0]):
        away = RETURN_SHARE * p.weight_reference * (moves.offsets[j] - p.reference) ** 2
        for k in range(SLOPES):
            cost[k, j] = away
    pace = max(speed, 1.0)
    for k in range(SLOPES):
        slope = (k - SLOPE_STEPS) * moves.unit
        cost[k] += p.weight_continuity * (slope * pace) ** 2
        front, rear, side = outline(slope, p)
        _add_edges(cost[k], moves.offsets, half_taken(slope, p), p)
        for m in range(limits.shape[0]):
            shift = view.speeds[m] * moves.time
            low, high = lateral_interval(sheared[m, k], shift, moves.begin - rear, moves.end + front)
            if low > high:
                continue
            raised = slope * (moves.end - shift)
            change = view.committed[m] * change_of_side(m, view, speed, p)
            _add_obstacle(cost[k], moves.offsets, (low + raised, high + raised, limits[m], side), change, p)


@kernel
def _add_edges(cost, offsets, half, p):
    """The price of the road's edges in one row; `half` is what the outline takes to a side, in [m]."""
    for j in range(offsets.shape[0]):
        gap = min(offsets[j] - p.right_edge, p.left_edge - offsets[j]) - half
        if gap < 0.0:
            cost[j] = np.inf
        elif gap < p.buffer:
            cost[j] += NEAR_COST * (1.0 - gap / p.buffer) ** 2


@kernel
def _add_obstacle(cost, offsets, box, change, p):
    """The price of an obstacle in one row; `box` holds its ends across, the least distance and half the width [m]."""
    low, high, limit, side = box
    wanted = p.buffer + p.tightening + p.margin_time * CREEP
    for j in range(offsets.shape[0]):
        gap = max(low - offsets[j], offsets[j] - high) - side
        if gap < limit - 0.5 * LATERAL_STEP:
            cost[j] = np.inf
        elif gap < wanted:
            cost[j] += NEAR_COST * ((wanted - gap) / (wanted - limit)) ** 2
        if change * (offsets[j] - 0.5 * (low + high)) < 0.0:
            cost[j] += abs(change)
