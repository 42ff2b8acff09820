"""Rating of one signal against a reference after ISO/TS 18571: corridor, phase, magnitude and slope.

Both signals are sampled alike. With the reference t and the other c, n samples, T = max |t|:

    corridor   mean of z_i: 1 within 0.05 T of t_i, 0 beyond 0.5 T, ((0.5 T - |c_i - t_i|) / 0.45 T)^2 between
    phase      c moved by k samples, |k| <= 0.2 n, so that the correlation is largest: 1 - |k| / (0.2 n)
    magnitude  on the part that is left, warped in time (window 0.1 n): 1 - e / 0.5, e = sum |c - t| / sum |t|
    slope      on that part, unwarped, derivatives over 9 samples: 1 - e / 2, e = sum |c' - t'| / sum |t'|
    overall    0.4 corridor + 0.2 (phase + magnitude + slope)

No score is below 0. The standard is made for 10 kHz and signals without doubt about their zero line; the scores
hardly depend on the rate as long as 9 samples are short against what the signals do.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import kernel

Array = NDArray[np.float64]

INNER, OUTER, LARGEST_SHIFT, WINDOW = 0.05, 0.5, 0.2, 0.1
LARGEST_MAGNITUDE, LARGEST_SLOPE = 0.5, 2.0
FEWEST = 20
"""Samples below which slope and shift mean nothing."""
GRADES = ((0.94, "excellent"), (0.80, "good"), (0.58, "fair"), (-1.0, "poor"))
"""Lowest overall rating of each grade, table of ISO/TS 18571."""


@dataclass(frozen=True)
class Rating:
    """Scores from 0 to 1, see the head of this module."""

    corridor: float
    phase: float
    magnitude: float
    slope: float

    @property
    def overall(self) -> float:
        """The weighted sum."""
        return 0.4 * self.corridor + 0.2 * (self.phase + self.magnitude + self.slope)

    @property
    def grade(self) -> str:
        """Excellent, good, fair or poor."""
        return next(grade for lowest, grade in GRADES if self.overall > lowest)


def rate(reference: Array, other: Array) -> Rating:
    """Rate `other` against `reference`, both of shape (n,), sampled at the same times.

    Raises:
        InputError: Different lengths, too few samples, not finite, or a reference that never changes.
    """
    reference, other = np.asarray(reference, dtype=float), np.asarray(other, dtype=float)
    if reference.shape != other.shape or reference.ndim != 1 or len(reference) < FEWEST:
        raise InputError("rating", f"shapes {reference.shape} and {other.shape}", f"(n,) both, n >= {FEWEST}")
    if not np.isfinite(reference).all() or not np.isfinite(other).all():
        raise InputError("rating", "a signal that is not finite", "finite samples")
    if np.ptp(reference) == 0.0:
        raise InputError("rating", "a reference that never changes", "one that does")
    shift = best_shift(reference, other)
    n, k = len(reference), abs(shift)
    moved = (reference[: n - k], other[k:]) if shift > 0 else (reference[k:], other[: n - k])
    return Rating(
        corridor=_corridor(reference, other),
        phase=max(1.0 - k / (LARGEST_SHIFT * n), 0.0),
        magnitude=_magnitude(*moved),
        slope=_slope(*moved),
    )


def best_shift(reference: Array, other: Array) -> int:
    """Samples by which `other` comes late (negative: early), where the correlation is largest; the least of several."""
    n = len(reference)
    best, shift = _correlation(reference, other), 0
    for k in range(1, math.floor(LARGEST_SHIFT * n) + 1):
        for sign, correlation in (
            (1, _correlation(reference[: n - k], other[k:])),
            (-1, _correlation(reference[k:], other[: n - k])),
        ):
            if correlation > best:
                best, shift = correlation, sign * k
    return shift


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    norm = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norm if norm > 0.0 else -math.inf


def _corridor(reference: Array, other: Array) -> float:
    largest = np.abs(reference).max()
    away = np.abs(other - reference) / largest
    return float(np.mean(np.clip((OUTER - away) / (OUTER - INNER), 0.0, 1.0) ** 2))


def _magnitude(reference: Array, other: Array) -> float:
    i, j = warping_path(other, reference, math.ceil(WINDOW * len(reference)) - 1)
    return _score(np.abs(other[i] - reference[j]), np.abs(reference[j]), LARGEST_MAGNITUDE)


def _slope(reference: Array, other: Array) -> float:
    slope_t, slope_c = _smooth(np.gradient(reference)), _smooth(np.gradient(other))
    return _score(np.abs(slope_c - slope_t), np.abs(slope_t), LARGEST_SLOPE)


def _score(error: Array, size: Array, largest: float) -> float:
    """1 without error, falling to 0 where the error's sum is `largest` times the size's."""
    worst = largest * float(size.sum())
    return max(1.0 - float(error.sum()) / worst, 0.0) if worst > 0.0 else float(not error.any())


def _smooth(values: Array) -> Array:
    """Mean of nine; towards the ends of 1, 3, 5, 7 counted from the end, as the standard has it."""
    smooth = np.empty_like(values)
    smooth[4:-4] = np.convolve(values, np.full(9, 1.0 / 9.0), mode="valid")
    for i in range(4):
        smooth[i], smooth[-1 - i] = values[: 2 * i + 1].mean(), values[len(values) - 2 * i - 1 :].mean()
    return smooth


@kernel
def warping_path(a: Array, b: Array, window: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Dynamic time warping: the path of least squared distance, within `window` samples of the diagonal.

    Returns:
        Indices into `a` and `b` along the path, both of shape (p,).
    """
    n, m = a.shape[0], b.shape[0]
    width = 2 * window + 1
    cost = np.full((n, width + 2), np.inf)  # column j - i + window + 1: a band beside the diagonal
    step = np.zeros((n, width + 2), dtype=np.int8)
    for i in range(n):
        for j in range(max(0, i - window), min(m, i + window + 1)):
            c = j - i + window + 1
            best, way = (0.0, 0) if i == 0 and j == 0 else (np.inf, 0)
            if i > 0 and cost[i - 1, c + 1] < best:
                best, way = cost[i - 1, c + 1], 1
            if j > 0 and cost[i, c - 1] < best:
                best, way = cost[i, c - 1], 2
            if i > 0 and j > 0 and cost[i - 1, c] < best:
                best, way = cost[i - 1, c], 3
            cost[i, c] = best + (a[i] - b[j]) ** 2
            step[i, c] = way
    path_a, path_b = np.empty(n + m, dtype=np.int64), np.empty(n + m, dtype=np.int64)
    i, j, length = n - 1, m - 1, 0
    while True:
        path_a[length], path_b[length] = i, j
        length += 1
        way = step[i, j - i + window + 1]
        if way == 0:
            break
        if way != 2:
            i -= 1
        if way != 1:
            j -= 1
    return path_a[:length][::-1], path_b[:length][::-1]
