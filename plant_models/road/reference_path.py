"""The road: a reference path with arc length, and the road frame (s, l) along it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import (
    Array,
    curvature_at,
    lay,
    point_at,
    pose_at,
    project_at,
    with_ends,
)
from sidestep.plant_models.road.fitting import along
from sidestep.plant_models.road.polyline import Polyline
from sidestep.plant_models.road.segments import Segment, split
from sidestep.plant_models.road.waypoint_file import read_waypoints
from sidestep.plant_models.road.waypoints import WayPoints, named
from sidestep.plant_models.road.widths import Widths

_CLOSING_GAP = 1e-3  # between the ends of a closed path [m, rad]


@dataclass(frozen=True, eq=False)
class ReferencePath:
    """A smooth directed path and the road frame along it: s forward in [m], l positive to the left in [m].

    A closed path goes on for ever: s counts on over the laps. An open one goes on straight before s = 0 and
    beyond s = length. Every method takes numbers or arrays, which it broadcasts.

    Attributes:
        table: The pieces, shape (n + 2, 6), read-only; for kernels, see `clothoid`.
        closed: Whether the end joins the start.
        edges: How wide the road is; a table of constant spacing, for kernels, too.
        given: The polyline of the way-points that it was laid along; None if it was not.
        nodes: Arc length along that polyline of each row from 1 on, ascending, in [m].
        origin: What was taken off the way-points' coordinates, in [m].
        notes: What was put right or smoothed, for the user.
    """

    table: Array = field(repr=False)
    closed: bool
    edges: Widths = field(default_factory=Widths.constant, repr=False)
    given: Polyline | None = field(default=None, repr=False)
    nodes: Array | None = field(default=None, repr=False)
    origin: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.table.flags.writeable:  # else it is as good as ours
            object.__setattr__(self, "table", np.array(self.table, dtype=np.float64))
            self.table.flags.writeable = False

    def __reduce__(self) -> Any:
        # The default would bring back a writeable table.
        return ReferencePath, tuple(getattr(self, f.name) for f in fields(self))

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
        pieces = np.concatenate([split(segment, f"road.segments[{i}]") for i, segment in enumerate(segments)])
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
    def from_waypoints(cls, xy: ArrayLike, closed: bool | None = None, smooth: float | None = None) -> "ReferencePath":
        """A path along way-points that strays from their polyline by 0.1 m at most; see `fitting`.

        Args:
            xy: Points, shape (N, 2), in [m]; two give a line.
            closed: None finds out: closed if the way from the last point to the first looks like any other.
            smooth: In [m]: may stray by that much instead, so as to be smooth all along.

        Raises:
            InputError: Too few or non-finite points, or a path along them would stray further or bend more tightly
                than MAX_CURVATURE.
        """
        points = np.asarray(xy, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2:
            raise InputError("road.waypoints", f"shape {points.shape}", "(N, 2)")
        return cls.through(named(points, closed), smooth)

    @classmethod
    def from_csv(cls, path: str | Path, closed: bool | None = None, smooth: float | None = None) -> "ReferencePath":
        """A path along the way-points of a CSV file, see `read_waypoints`, with the widths that it holds.

        Raises:
            InputError: As `from_waypoints`, with file and line.
        """
        return cls.through(read_waypoints(path, closed), smooth)

    @classmethod
    def through(cls, points: WayPoints, smooth: float | None = None) -> "ReferencePath":
        """A path along way-points, with their widths; see `from_waypoints`."""
        points = points.cleaned()
        fit = along(points, smooth)
        path = cls(fit.table, bool(points.closed), Widths.constant(), points.line, fit.nodes, points.origin,
                   (*points.notes, *fit.notes))  # fmt: skip
        if points.left is None or points.right is None:
            return path
        s = path.station_of(points.line.stations)
        return replace(path, edges=Widths.at_stations(s, points.left, points.right, path.length, path.closed))

    def with_edges(self, edges: Widths) -> "ReferencePath":
        """The same path on a road of other widths; those given with the way-points are forgotten."""
        given = self.given and replace(self.given, widths=None)
        return replace(self, edges=edges, given=given)

    def widths(self, s: float | Array) -> tuple[Array, Array]:
        """Distance from the path to the road's left and right edge at arc length s [m], in [m]."""
        return self.edges.at(s, self.period)

    def given_station(self, s: ArrayLike) -> Array:
        """Arc length along the way-points' polyline that belongs to stations s [m] of the path, in [m]."""
        s = np.asarray(s, dtype=np.float64)
        if self.nodes is None:
            return s
        return np.interp(np.remainder(s, self.length) if self.closed else s, self.table[1:, 0], self.nodes)

    def station_of(self, u: ArrayLike) -> Array:
        """Arc length along the path, in [m], that belongs to arc lengths u [m] along the way-points' polyline."""
        u = np.asarray(u, dtype=np.float64)
        if self.nodes is None:
            return u
        ends = self.nodes[-1]
        lap = np.floor(u / ends) if self.closed else np.zeros_like(u)
        inner = u - lap * ends
        outside = np.minimum(inner, 0.0) + np.maximum(inner - ends, 0.0)
        return np.interp(inner, self.nodes, self.table[1:, 0]) + lap * self.length + outside

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
