"""A polyline as it was given: its own arc length, points beside it, and how far other points stray from it."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import Array


@dataclass(frozen=True, eq=False)
class Polyline:
    """Straight chords between points, with arc length u along them; nothing is smoothed.

    Attributes:
        points: Shape (n, 2), in [m]; on a closed one the last is the first again.
        closed: Whether u counts on over the laps.
        widths: Of the road to the left and right of each point, shape (n, 2), in [m]; None if they were not given.
    """

    points: Array = field(repr=False)
    closed: bool = False
    widths: Array | None = field(default=None, repr=False)

    @cached_property
    def stations(self) -> Array:
        """Arc length at every point, shape (n,), in [m]."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))])

    @property
    def length(self) -> float:
        """In [m]."""
        return float(self.stations[-1])

    @cached_property
    def chord_headings(self) -> Array:
        """Direction of every chord, continuous, shape (n - 1,), in [rad]."""
        steps = np.diff(self.points, axis=0)
        return np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))

    @cached_property
    def turns(self) -> Array:
        """By how much the polyline turns at every point, shape (n,), in [rad]; 0 at the ends of an open one."""
        inner = np.diff(self.chord_headings)
        ends = math.remainder(self.chord_headings[0] - self.chord_headings[-1], math.tau) if self.closed else 0.0
        return np.concatenate([[ends], inner, [ends]])

    def on(self, u: ArrayLike) -> Array:
        """Points on it, shape (m, 2), in [m]; straight on beyond the ends of an open one."""
        x, y = self.beside(u, 0.0)
        return np.column_stack([x, y])

    def beside(self, u: ArrayLike, offset: ArrayLike) -> tuple[Array, Array]:
        """Points at arc lengths u [m], `offset` [m] to the left of their chords."""
        at, row = self._chord(u)
        step = np.diff(self.points, axis=0)[row]
        length = np.diff(self.stations)[row]
        along = (at - self.stations[row]) / length
        across = np.asarray(offset) / length
        x = self.points[row, 0] + along * step[:, 0] - across * step[:, 1]
        return x, self.points[row, 1] + along * step[:, 1] + across * step[:, 0]

    def heading(self, u: ArrayLike) -> Array:
        """Direction at arc lengths u, in [rad]: at a point the mean of its two chords', in between interpolated."""
        at, _ = self._chord(u)
        chords, turns = self.chord_headings, self.turns
        at_points = np.append(chords, chords[-1] + turns[-1]) - 0.5 * turns
        return np.interp(at, self.stations, at_points)

    def _chord(self, u: ArrayLike) -> tuple[Array, NDArray[np.intp]]:
        at = np.atleast_1d(np.asarray(u, dtype=np.float64))
        if self.closed:
            at = np.remainder(at, self.length).astype(np.float64)
        return at, np.clip(np.searchsorted(self.stations, at, side="right") - 1, 0, len(self.points) - 2)


@kernel
def strays(line: Array, stations: Array, points: Array, near: Array, reach: float) -> Array:
    """Distance of points from that part of a polyline on which they belong.

    Args:
        line: Its points, shape (n, 2), in [m].
        stations: Arc length or other measure at each, ascending, shape (n,).
        points: Shape (m, 2), in [m].
        near: Measure at which each belongs, shape (m,).
        reach: Chords that are further off by that measure do not count.

    Returns:
        Distance, in [m], and measure of the nearest point on the polyline, shape (2, m).
    """
    result = np.empty((2, len(points)))
    first = np.searchsorted(stations, near - reach, side="right") - 1
    for i in range(len(points)):
        j, best, foot = max(first[i], 0), math.inf, near[i]
        while j < len(line) - 1 and (stations[j] <= near[i] + reach or best == math.inf):
            dx, dy = line[j + 1, 0] - line[j, 0], line[j + 1, 1] - line[j, 1]
            px, py = points[i, 0] - line[j, 0], points[i, 1] - line[j, 1]
            square = dx * dx + dy * dy
            share = min(max((px * dx + py * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            ox, oy = px - share * dx, py - share * dy
            if ox * ox + oy * oy < best:
                best, foot = ox * ox + oy * oy, stations[j] + share * (stations[j + 1] - stations[j])
            j += 1
        result[:, i] = math.sqrt(best), foot
    return result
