"""What the nodes of the lattice cost: distance to the reference (10) and to obstacles (12), and what is in the way."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.decision.corridor import lateral_interval
from sidestep.controller.decision.lattice import LATERAL_STEP
from sidestep.controller.decision.view import View
from sidestep.plant_models.kernels import Array, Record, kernel

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


class Lattice(NamedTuple):
    """Nodes: stations of the layers [m] and when the car is there [s], shape (S,); offsets across [m], shape (L,)."""

    stations: NDArray[np.float64]
    times: NDArray[np.float64]
    offsets: NDArray[np.float64]


@kernel
def _way_back(last, speed, view, p):
    """Stations up to `last` where the car has passed what is on the reference, and where it is back on it, in [m]."""
    passed, settled = 0.0, 0.0
    for m in range(view.speeds.shape[0]):
        polygon, pace = view.polygons[m], view.speeds[m]
        low, high = polygon[:, 1].min(), polygon[:, 1].max()
        needed = p.half_width + p.buffer + min(p.reference - low, high - p.reference)
        if needed > 0.5 * LATERAL_STEP and speed > pace:
            behind = speed / (speed - pace) * (polygon[:, 0].max() + p.rear)
            if behind < last:
                passed = max(passed, behind)
                settled = max(settled, behind + RETURN_TIME * math.sqrt(needed) * speed)
    return passed, settled


@kernel
def node_costs(nodes: Lattice, speed: float, view: View, p: Record) -> tuple[Array, float]:
    """Costs (10) and (12) of every node, and the price of what is in the way.

    Args:
        nodes: Lattice.
        speed: Of the car, in [m/s].
        view: Obstacles.
        p: PlannerSettings.

    Returns:
        Shape (S, L); entries >= BLOCKED_COST lie within half width and buffer of an obstacle that is met. And the
        station from which on the car is back on the reference.
    """
    stations, offsets = nodes.stations, nodes.offsets
    cost = np.zeros((stations.shape[0], offsets.shape[0]))
    passed, settled = _way_back(stations[-1], speed, view, p)
    for m in range(view.speeds.shape[0]):
        _add_obstacle(cost, m, nodes, speed, view, p)
    for i in range(stations.shape[0]):
        share = APPROACH_SHARE if stations[i] < passed else RETURN_SHARE if stations[i] < settled else 1.0
        for j in range(offsets.shape[0]):
            cost[i, j] += share * p.weight_reference * (offsets[j] - p.reference) ** 2
    return cost, settled


@kernel
def change_of_side(m: int, view: View, speed: float, p: Record) -> float:
    """What it costs a layer to pass obstacle m on the other side than decided; `speed` is the car's, in [m/s]."""
    near = view.polygons[m, :, 0].min() - p.front < COMMITMENT_TIME * (speed - view.speeds[m])
    return p.hysteresis * (COMMITMENT if near else 1.0)


@kernel
def _add_obstacle(cost, m, nodes, speed, view, p):
    """Cost (12) of obstacle m, and the price of running into it or past it on the other side."""
    stations, polygon, pace = nodes.stations, view.polygons[m], view.speeds[m]
    begin, end = polygon[:, 0].min(), polygon[:, 0].max()
    low_all, high_all = polygon[:, 1].min(), polygon[:, 1].max()
    change = change_of_side(m, view, speed, p)
    soft = p.half_width + p.buffer + p.tightening + p.margin_time * speed
    for i in range(stations.shape[0]):
        half_layer = 0.5 * (stations[min(i + 1, stations.shape[0] - 1)] - stations[max(i - 1, 0)]) * 0.5
        shift = pace * nodes.times[i]
        along = max(begin + shift - stations[i] - p.reach, stations[i] - p.reach - end - shift, 0.0)
        if along > p.safe_distance + half_layer:
            continue
        share = 1.0 if stations[i] <= view.met_until[m] else FAR_SHARE
        reach = half_layer + p.reach
        low, high = lateral_interval(polygon, shift, stations[i] - reach, stations[i] + reach)
        inside = low <= high
        if not inside:
            low, high = low_all, high_all
        _add_row(cost[i], nodes.offsets, (low, high, along, soft, share), inside, view.committed[m], change, p)


@kernel
def _add_row(cost, offsets, box, inside, side, change, p):
    """The same in one layer; `box` holds its right and left end, its distance along, the soft margin and its share."""
    low, high, along, soft, share = box
    hard, half_step = p.half_width + p.buffer, 0.5 * LATERAL_STEP
    for j in range(offsets.shape[0]):
        gap = max(low - offsets[j], offsets[j] - high, 0.0)
        across = max(gap - soft, 0.0)
        if along * along + across * across < p.safe_distance**2:
            distance = math.sqrt(along * along + across * across)
            cost[j] += p.weight_obstacle * (p.safe_distance - distance) ** 2
        if inside:
            if gap < soft:
                cost[j] += NEAR_COST
            if gap < hard - half_step:
                cost[j] += share * BLOCKED_COST
            if gap < p.half_width - half_step:
                cost[j] += share * COLLISION_COST
            if side * (offsets[j] - 0.5 * (low + high)) < 0.0:
                cost[j] += change
