"""The smoothest curve within a tube around a polyline.

Least third difference of positions (Whittaker 1923, Henderson 1924), that is least change of curvature, while distance
from the polyline is weighted up, where it is too large, until it is within the tolerance everywhere.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from sidestep.plant_models.road.clothoid import Array
from sidestep.plant_models.road.polyline import Polyline, strays

Mask = NDArray[np.bool_]

TOLERANCE = 0.1
"""How far a path may stray from its way-points' polyline, in [m]."""
REACH = 4.0
"""Along the polyline: what lies beyond is another leg, in [m]."""
AIM = 0.9
"""Share of a tolerance that is aimed at."""

_SCALE = 4.0  # length below which features are smoothed away at that tolerance, in [m]
_PASSES = 200  # reweightings at most
_PIN = 1e9  # weight of what may not move


def smoothed(line: Polyline, u: Array, positions: Array, pins: Mask, step: float, tolerance: float) -> Array:
    """Positions of least change of curvature within the tolerance.

    Args:
        line: From which they may stray.
        u: Arc length along it of each, evenly spaced, shape (n,), in [m]; of a closed one any lap.
        positions: Where those that are pinned stay, shape (n, 2), in [m].
        pins: Which are pinned, shape (n,).
        step: Between two of `u`, in [m].
        tolerance: In [m].

    Returns:
        Shape (n, 2), in [m]; where the tolerance cannot be kept it is not.
    """
    target = np.where(pins[:, None], positions, line.on(u))
    scale = _SCALE * (tolerance / TOLERANCE) ** (1.0 / 3.0)
    weights = np.where(pins, _PIN, scale**-6.0)
    points, stations = _part(line, u)
    roughness = _third_differences(len(u), step)
    result = target
    for _ in range(_PASSES):
        bands = roughness.copy()
        bands[3] += weights
        result = solveh_banded(bands, weights[:, None] * target, overwrite_ab=True)
        off = strays(points, stations, result, u, REACH)[0]
        missed = strays(result, u, points, stations, REACH)[0]
        at = np.clip(np.searchsorted(u, stations), 0, len(u) - 1)
        np.maximum.at(off, at, missed)
        off[pins] = 0.0
        excess = off / (AIM * tolerance)
        if excess.max() <= 1.0:
            break
        weights *= np.clip(excess, 1.0, 2.0)
    return result


def _part(line: Polyline, u: Array) -> tuple[Array, Array]:
    """Points and arc lengths of the polyline from u[0] to u[-1], laps unrolled, its ends included."""
    laps = range(math.floor(u[0] / line.length), math.floor(u[-1] / line.length) + 1) if line.closed else range(1)
    stations = np.concatenate(
        [line.stations[:-1] + lap * line.length for lap in laps] + ([] if line.closed else [line.stations[-1:]])
    )
    inside = stations[(stations > u[0]) & (stations < u[-1])]
    stations = np.concatenate([u[:1], inside, u[-1:]])
    return line.on(stations), stations


def _third_differences(count: int, step: float) -> Array:
    """Upper bands of D'D / step^6 for the third difference D, shape (4, n), as `solveh_banded` takes them."""
    bands, coefficients, rows = np.zeros((4, count)), (-1.0, 3.0, -3.0, 1.0), count - 3
    for a in range(4):
        for b in range(a, 4):
            bands[3 + a - b, b : b + rows] += coefficients[a] * coefficients[b] / step**6
    return bands
