"""Way-points and what is put right before a path is laid along them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import MAX_LENGTH, Array
from sidestep.plant_models.road.polyline import Polyline

SAME_POINT = 0.01
"""Points closer than this to the one before are one point, in [m]."""
FAR_AWAY = 1e5
"""Coordinates beyond are counted from a new origin, in [m]."""
KINK = math.radians(20.0)
"""Turn at one point from which on it is named."""


@dataclass(frozen=True, eq=False)
class WayPoints:
    """Points of a road's reference, and the widths beside them.

    Attributes:
        points: Shape (n, 2), in [m]; on a closed road the last is the first again, once `cleaned`.
        place: What errors call point i.
        where: What they call all of them.
        left, right: Widths at the points, shape (n,), in [m]; None if not given.
        closed: Whether the last joins the first; None is not known yet.
        origin: What was taken off the coordinates, in [m].
        notes: What was put right, for the user.
    """

    points: Array = field(repr=False)
    place: Callable[[int], str]
    where: str
    left: Array | None = None
    right: Array | None = None
    closed: bool | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()

    @property
    def line(self) -> Polyline:
        """The polyline through them."""
        widths = None
        if self.left is not None and self.right is not None:
            widths = np.column_stack([self.left, self.right])
        return Polyline(self.points, bool(self.closed), widths)

    def cleaned(self) -> "WayPoints":
        """Checked, without repetitions, closed or not, near the origin; every change is in `notes`.

        Raises:
            InputError: Too few, too long or not finite.
        """
        for i in np.flatnonzero(~np.isfinite(self.points).all(axis=1)).tolist():
            raise InputError(self.place(i), f"({self.points[i, 0]}, {self.points[i, 1]}) is not finite")
        return self._merged()._joined()._near_origin()._kinks_named()

    def _merged(self) -> "WayPoints":
        kept = _apart(self.points, SAME_POINT)
        if len(kept) == len(self.points):
            return self
        first = int(np.flatnonzero(np.diff(kept, append=len(self.points)) > 1)[0])
        gone = len(self.points) - len(kept)
        note = f"merged {gone} way-points closer than 1 cm to the one before, first {self.place(int(kept[first]) + 1)}"
        return replace(self._chosen(kept), notes=(*self.notes, note))

    def _chosen(self, kept: NDArray[np.intp]) -> "WayPoints":
        place, widths = self.place, [None if w is None else w[kept] for w in (self.left, self.right)]
        return replace(
            self,
            points=self.points[kept],
            left=widths[0],
            right=widths[1],
            place=lambda i: place(int(kept[i % len(kept)])),
        )

    def _joined(self) -> "WayPoints":
        """With the first point again at the end of a closed road."""
        points, notes = self.points, self.notes
        returns = len(points) > 2 and math.dist(points[0], points[-1]) < SAME_POINT
        closed = self.closed
        if closed is None:
            closed = returns or _comes_round(points)
            if closed and not returns:
                gap = math.dist(points[0], points[-1])
                notes = (
                    *notes,
                    f"taken as closed: the last way-point is {gap:.1f} m before the first (closed = false opens it)",
                )
        order = np.arange(len(points))
        if closed:
            order = np.append(order[:-1] if returns else order, 0)
        if len(order) < (4 if closed else 2):
            raise InputError(
                self.where, f"{len(order) - closed} points", "at least 2, or 3 different ones on a closed path"
            )
        result = replace(self._chosen(order), closed=closed, notes=notes)
        if (length := result.line.length) > MAX_LENGTH:
            raise InputError(self.where, f"{length:.3g} m long", f"<= {MAX_LENGTH:g} m")
        return result

    def _near_origin(self) -> "WayPoints":
        if np.abs(self.points).max() <= FAR_AWAY:
            return self
        x, y = (float(value) for value in np.round(self.points[0], -3))
        note = f"coordinates are counted from ({x:.0f}, {y:.0f})"
        return replace(self, points=self.points - (x, y), origin=(x, y), notes=(*self.notes, note))

    def _kinks_named(self) -> "WayPoints":
        turns = self.line.turns
        kinks = np.flatnonzero(np.abs(turns[:-1] if self.closed else turns) >= KINK)
        if len(kinks) == 0:
            return self
        worst = int(kinks[np.argmax(np.abs(turns[kinks]))])
        note = (
            f"{len(kinks)} way-points turn by {math.degrees(KINK):.0f} degrees or more, by {self.turn_at(worst)} most"
        )
        return replace(self, notes=(*self.notes, note))

    def turn_at(self, i: int) -> str:
        """The turn at point i, and where that is."""
        return f"{abs(math.degrees(self.line.turns[i])):.0f} degrees at {self.place(i)}"


def _comes_round(points: Array) -> bool:
    """Whether the way from the last point to the first looks like any other: no longer, and no sharper turn."""
    if len(points) < 4:
        return False
    line = Polyline(np.vstack([points, points[:1]]), closed=True)
    steps, turns = np.diff(line.stations), np.abs(line.turns[:-1])
    widest = max(math.radians(30.0), float(turns[1:-1].max()))
    ends = max(turns[0], turns[-1])
    return bool(steps[-1] <= 2.0 * steps[:-1].max() and ends <= widest and line.length > 10.0 * steps[-1])


@kernel
def _apart(points, distance):
    """Which points stay if those near the last one that stayed go."""
    kept = np.empty(len(points), np.int64)
    count, last = 0, -1
    for i in range(len(points)):
        if last < 0 or np.hypot(points[i, 0] - points[last, 0], points[i, 1] - points[last, 1]) >= distance:
            kept[count], last = i, i
            count += 1
    return kept[:count]


def named(points: Array, closed: bool | None = None) -> WayPoints:
    """Way-points of a programme: errors call them by their number."""
    return WayPoints(points, lambda i: f"road.waypoints[{i}]", "road.waypoints", closed=closed)
