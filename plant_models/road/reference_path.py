"""The road: a reference path with arc length, and the road frame (s, l) along it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import (
    MAX_CURVATURE,
    MAX_LENGTH,
    SPACING,
    Array,
    curvature_at,
    lay,
    point_at,
    pose_at,
    project_at,
    with_ends,
)
from sidestep.plant_models.road.waypoints import read_waypoints, through_waypoints

_CLOSING_GAP = 1e-3  # between the ends of a closed path [m, rad]


@dataclass(frozen=True, slots=True)
class Line:
    """A straight piece of road; length in [m]."""

    length: float

    def __post_init__(self) -> None:
        _check_segment(self)


@dataclass(frozen=True, slots=True)
class Arc:
    """A circular piece of road; length in [m], curvature in [1/m], positive to the left."""

    length: float
    curvature: float

    def __post_init__(self) -> None:
        _check_segment(self)


@dataclass(frozen=True, slots=True)
class Clothoid:
    """A piece of road whose curvature [1/m] changes linearly with arc length; length in [m]."""

    length: float
    curvature_start: float
    curvature_end: float

    def __post_init__(self) -> None:
        _check_segment(self)


Segment = Line | Arc | Clothoid


@dataclass(frozen=True, eq=False)
class ReferencePath:
    """A smooth directed path and the road frame along it: s forward in [m], l positive to the left in [m].

    A closed path goes on for ever: s counts on over the laps. An open one goes on straight before s = 0 and
    beyond s = length. Every method takes numbers or arrays, which it broadcasts.

    Attributes:
        table: The pieces, shape (n + 2, 6), read-only; for kernels, see `clothoid`.
        closed: Whether the end joins the start.
    """

    table: Array = field(repr=False)
    closed: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "table", np.array(self.table, dtype=np.float64))
        self.table.flags.writeable = False

    def __reduce__(self) -> Any:
        # The default would bring back a writeable table.
        return ReferencePath, (self.table, self.closed)

    @cached_property
    def length(self) -> float:
        """Arc length from start to end, in [m]."""
        return float(self.table[-1, 0])

    @cached_property
    def period(self) -> float:
        """What the kernels of `clothoid` take beside `table`: length if closed, else 0, in [m]."""
        return self.length if self.closed else 0.0

    @classmethod
    def from_segments(
        cls,
        segments: Sequence[Segment],
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
        closed: bool | None = None,
    ) -> "ReferencePath":
        """A path of lines, arcs and clothoids, joined in position and heading; exact to rounding.

        Args:
            segments: At least one.
            start: x, y, heading of the first one's start, in [m, m, rad].
            closed: None finds out: closed if the last end meets the start within 1 mm and 1 mrad.

        Raises:
            InputError: No segment or none at all, start not finite, or ends apart though `closed`.
        """
        if len(segments) == 0:
            raise InputError("road.segments", "empty", "at least one line, arc or clothoid")
        if not all(math.isfinite(value) for value in start):
            raise InputError("road.start", f"{start} is not finite")
        pieces = np.concatenate([_split(segment, f"road.segments[{i}]") for i, segment in enumerate(segments)])
        table = np.empty((len(pieces) + 2, 6))
        x, y, heading = (float(value) for value in start)
        lay(table, x, y, heading, pieces)
        gap, turn = math.dist(table[-1, 1:3], table[1, 1:3]), math.remainder(table[-1, 3] - table[1, 3], math.tau)
        joined = max(gap, abs(turn)) <= _CLOSING_GAP
        if closed and not joined:
            problem = f"the end is {gap:.3g} m and {turn:.3g} rad off the start of a path that is to be closed"
            raise InputError("road.segments", problem)
        closed = joined if closed is None else closed
        return cls(with_ends(table, closed), closed)

    @classmethod
    def from_waypoints(cls, xy: ArrayLike, closed: bool | None = None) -> "ReferencePath":
        """A path through way-points, a cubic spline (C2).

        Args:
            xy: Points, shape (N, 2), in [m]; two give a line.
            closed: None finds out: closed if the last point is the first one again.

        Raises:
            InputError: Too few, repeated or non-finite points, or a bend tighter than MAX_CURVATURE.
        """
        points = np.asarray(xy, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2:
            raise InputError("road.waypoints", f"shape {points.shape}", "(N, 2)")
        names = [f"road.waypoints[{i}]" for i in range(len(points))]
        return cls(*through_waypoints(points, names, "road.waypoints", closed))

    @classmethod
    def from_csv(cls, path: str | Path, closed: bool | None = None) -> "ReferencePath":
        """A path through the way-points of a CSV file, see `read_waypoints`.

        Raises:
            InputError: As `from_waypoints`, with file and line.
        """
        points, names = read_waypoints(path)
        return cls(*through_waypoints(points, names, str(path), closed))

    @overload
    def curvature(self, s: float) -> float: ...
    @overload
    def curvature(self, s: Array) -> Array: ...
    def curvature(self, s: float | Array) -> float | Array:
        """Curvature in [1/m] at arc length s [m], positive to the left."""
        if _are_numbers(s):
            return curvature_at(self.table, self.period, float(s))
        return _curvatures(self.table, self.period, _flat(s)).reshape(np.shape(s))

    @overload
    def heading(self, s: float) -> float: ...
    @overload
    def heading(self, s: Array) -> Array: ...
    def heading(self, s: float | Array) -> float | Array:
        """Heading in [rad] at arc length s [m], continuous over turns and laps."""
        if _are_numbers(s):
            return pose_at(self.table, self.period, float(s))[2]
        return _points(self.table, self.period, _flat(s), np.zeros(np.size(s)))[2].reshape(np.shape(s))

    @overload
    def to_cartesian(self, s: float, offset: float) -> tuple[float, float]: ...
    @overload
    def to_cartesian(self, s: Array, offset: Array | float) -> tuple[Array, Array]: ...
    @overload
    def to_cartesian(self, s: float, offset: Array) -> tuple[Array, Array]: ...
    def to_cartesian(self, s: Any, offset: Any) -> Any:
        """World point x, y [m] at arc length s [m] and lateral offset l [m], positive to the left."""
        if _are_numbers(s, offset):
            return point_at(self.table, self.period, float(s), float(offset))[:2]
        stations, offsets = np.broadcast_arrays(s, offset)
        x, y, _ = _points(self.table, self.period, _flat(stations), _flat(offsets))
        return x.reshape(stations.shape), y.reshape(stations.shape)

    @overload
    def project(self, x: float, y: float, near: float | None = None) -> tuple[float, float, float]: ...
    @overload
    def project(self, x: Array, y: Array, near: Array | float | None = None) -> tuple[Array, Array, Array]: ...
    def project(self, x: Any, y: Any, near: Any = None) -> Any:
        """Road coordinates s, l [m] of world points and the heading [rad] of the road there.

        Args:
            x: World x of the points, in [m].
            y: World y of the points, in [m].
            near: Arc length [m] close to which they are, such as the last s of a moving point: keeps to that
                leg where the path crosses or passes itself, and counts laps. None for the nearest
                point of the whole path, with 0 <= s <= length on a closed one.
        """
        near = math.nan if near is None else near
        if _are_numbers(x, y, near):
            return project_at(self.table, self.period, float(x), float(y), float(near))
        points = np.broadcast_arrays(x, y, near)
        found = _projections(self.table, self.period, *map(_flat, points))
        return tuple(values.reshape(points[0].shape) for values in found)


def _are_numbers(*values: float | Array) -> bool:
    return all(isinstance(value, float) or np.ndim(value) == 0 for value in values)


def _flat(values: ArrayLike) -> Array:
    # A fresh copy: contiguous and writeable, so that the kernels compile for one array type.
    return np.array(values, dtype=np.float64).ravel()


@kernel
def _curvatures(table, period, s):
    result = np.empty_like(s)
    for i in range(s.size):
        result[i] = curvature_at(table, period, s[i])
    return result


@kernel
def _points(table, period, s, offset):
    result = np.empty((3, s.size))
    for i in range(s.size):
        result[:, i] = point_at(table, period, s[i], offset[i])
    return result


@kernel
def _projections(table, period, x, y, near):
    result = np.empty((3, x.size))
    for i in range(x.size):
        result[:, i] = project_at(table, period, x[i], y[i], near[i])
    return result


def _check_segment(segment: Segment) -> None:
    for f in fields(segment):
        value, where = getattr(segment, f.name), f"segment.{f.name}"
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(where, f"{value!r} is not a finite number")
        if f.name == "length" and not 0.0 < value <= MAX_LENGTH:
            raise InputError(where, f"{value} m", f"0 < length <= {MAX_LENGTH:g}")
        if f.name != "length" and abs(value) > MAX_CURVATURE:
            raise InputError(where, f"{value} 1/m", f"-{MAX_CURVATURE:g} <= curvature <= {MAX_CURVATURE:g}")


def _split(segment: Segment, where: str) -> Array:
    """Length, curvature at the start and sharpness of the pieces of a segment, shape (n, 3)."""
    match segment:
        case Line(length):
            start = end = 0.0
        case Arc(length, start):
            end = start
        case Clothoid(length, start, end):
            pass
        case _:
            raise InputError(where, f"{segment!r}", "Line, Arc, Clothoid")
    count = math.ceil(length / SPACING)
    sharpness = (end - start) / length
    curvature = start + sharpness * length / count * np.arange(count)
    return np.column_stack([np.full(count, length / count), curvature, np.full(count, sharpness)])
