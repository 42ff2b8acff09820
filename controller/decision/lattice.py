"""The lattice over the road: where its layers stand, when the car is there, and the shortest path through it.

Layers stand at fixed stations of the road, so that what was optimal a step ago stays optimal and the path
does not flicker; their spacing grows with speed, which makes (8) a bound on lateral speed.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.kernels import Array, kernel

SPACING_TIME = 1.0 / 15.0
MIN_SPACING = 0.5
LATERAL_STEP = 0.08
TIE = 1e-9


@kernel
def layer_spacing(speed: float) -> float:
    """Distance between layers at a speed in [m/s], in [m]."""
    return max(MIN_SPACING, SPACING_TIME * round(max(speed, 1.0)))


@kernel
def arrival_times(stations: Array, speed: float, cruise: float, acceleration: float) -> Array:
    """When a car that goes back to its cruising speed is at stations ahead, from now, in [s].

    A car that follows a slow one would pass for free if it were taken to stay as slow as it is.

    Args:
        stations: In [m], shape (S,).
        speed, cruise: In [m/s].
        acceleration: In [m/s^2].
    """
    v = max(speed, 0.0)
    times = np.empty(stations.shape[0])
    if v >= cruise:
        times[:] = stations / max(v, 1.0)
        return times
    until = (cruise * cruise - v * v) / (2.0 * acceleration)
    for i in range(stations.shape[0]):
        s = stations[i]
        if s < until:
            times[i] = (math.sqrt(v * v + 2.0 * acceleration * s) - v) / acceleration
        else:
            times[i] = (cruise - v) / acceleration + (s - until) / cruise
    return times


@kernel
def shortest_path(
    cost: Array, first_weight: float, weight: float, reach: int, start: float, start_reach: float, home: float
) -> tuple[NDArray[np.int64], float]:
    """Path of least cost through all layers, exactly.

    Args:
        cost: Node costs, shape (S, L).
        first_weight, weight: Of the squared lateral step, in nodes, into the first layer and between layers.
        reach: Largest lateral step (8), in nodes.
        start: Lateral position before the first layer, in nodes (need not be whole).
        start_reach: Largest first step, in nodes.
        home: Lateral position preferred among equals, so that mirrored scenes give mirrored paths, in nodes.

    Returns:
        Node index per layer, shape (S,), and the least cost; infinite if (8) admits no path.
    """
    layers, lateral = cost.shape
    best = np.full((layers, lateral), np.inf)  # least cost up to and with each node
    for j in range(lateral):
        step = j - start
        if abs(step) <= start_reach:
            best[0, j] = first_weight * step * step + cost[0, j]
    for i in range(1, layers):
        for k in range(-reach, reach + 1):
            extra, low, count = weight * k * k, max(0, -k), max(lateral - abs(k), 0)
            before, here = best[i - 1, low + k : low + k + count], best[i, low : low + count]
            for j in range(count):  # slices and no call to min: the compiler makes vectors of it
                value = before[j] + extra
                here[j] = value if value < here[j] else here[j]
        for j in range(lateral):
            best[i, j] += cost[i, j]
    path = np.empty(layers, np.int64)
    path[-1] = 0
    for j in range(lateral):
        if _better(best[-1, j], j, best[-1, path[-1]], path[-1], home):
            path[-1] = j
    for i in range(layers - 1, 0, -1):
        path[i - 1], least = path[i], np.inf
        for j in range(max(path[i] - reach, 0), min(path[i] + reach, lateral - 1) + 1):
            value = best[i - 1, j] + weight * (j - path[i]) ** 2
            if _better(value, j, least, path[i - 1], home):
                path[i - 1], least = j, value
    return path, best[-1, path[-1]]


@kernel
def _better(value, node, least, other, home):
    if value < np.inf and abs(value - least) <= TIE * value:  # rounding must not decide
        return abs(node - home) < abs(other - home)
    return value < least
