"""Lanelets of a CommonRoad map: the way from a start to a goal, its reference line and the road's width beside it."""

import heapq
import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLE = 2.0
"""Spacing of the reference line's points beside lanes, in [m]."""
BEFORE, BEYOND = 60.0, 150.0
"""Of the reference line before the start and beyond the goal at least, if the map has it, in [m]."""


@dataclass
class Lanelet:
    """A piece of lane between two bounds.

    Attributes:
        left, right: Points of the bounds along the driving direction, shape (n, 2), in [m].
        successors, predecessors: Of the same lane.
        left_of, right_of: Neighbour on that side and whether it goes the same way; None if there is none.
        type: What the map says, such as "bicycleLane"; empty if nothing.
    """

    left: Array
    right: Array
    successors: list[int] = field(default_factory=list)
    predecessors: list[int] = field(default_factory=list)
    left_of: tuple[int, bool] | None = None
    right_of: tuple[int, bool] | None = None
    type: str = ""

    @cached_property
    def centre(self) -> Array:
        """Middle between the bounds, shape (n, 2), in [m]."""
        if len(self.left) == len(self.right):
            return 0.5 * (self.left + self.right)
        return 0.5 * (_resampled(self.left, 50) + _resampled(self.right, 50))

    @cached_property
    def length(self) -> float:
        """Of its middle, in [m]."""
        return float(np.hypot(*np.diff(self.centre, axis=0).T).sum())

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """Its outline."""
        return shapely.make_valid(shapely.Polygon(np.vstack([self.left, self.right[::-1]]))).buffer(0.0)

    def heading_at(self, x: float, y: float) -> float:
        """Direction of its middle near a point, in [rad]."""
        line = shapely.LineString(self.centre)
        along = float(shapely.line_locate_point(line, shapely.Point(x, y)))
        a, b = (line.interpolate(min(max(along + step, 0.0), line.length)) for step in (-0.5, 0.5))
        return math.atan2(b.y - a.y, b.x - a.x)


Map = dict[int, Lanelet]
Row = tuple[int, int]
"""Lanelets side by side in which a way goes on: the one it comes from and the one it leaves by."""


def lanelet_at(lanes: Map, x: float, y: float, yaw: float) -> int | None:
    """The lanelet that holds a point, the one that goes its way best; the nearest within 5 m if none does."""
    point = shapely.Point(x, y)
    distances = {key: lane.polygon.distance(point) for key, lane in lanes.items()}
    near = [key for key, distance in distances.items() if distance <= 1e-6]
    near = near or [key for key, distance in distances.items() if distance <= min(5.0, min(distances.values()) + 0.1)]

    def misfit(key: int) -> float:
        turn = abs(math.remainder(lanes[key].heading_at(x, y) - yaw, math.tau))
        return turn + 0.05 * shapely.LineString(lanes[key].centre).distance(point)

    return min(near, key=misfit, default=None)


def route(lanes: Map, start: int, goals: set[int]) -> list[Row] | None:
    """Shortest way to any of the goals, over successors and neighbours that go the same way; None if there is none."""
    queue, best, came = [(0.0, start)], {start: 0.0}, {}
    while queue:
        cost, key = heapq.heappop(queue)
        if cost > best[key]:
            continue
        if key in goals:
            return _rows(start, key, came)
        lane = lanes[key]
        steps = [(follower, lane.length, True) for follower in lane.successors]
        steps += [(side[0], 20.0, False) for side in (lane.left_of, lane.right_of) if side and side[1]]
        for other, way, on in steps:
            if other in lanes and cost + way < best.get(other, math.inf):
                best[other], came[other] = cost + way, (key, on)
                heapq.heappush(queue, (cost + way, other))
    return None


def _rows(start: int, end: int, came: dict[int, tuple[int, bool]]) -> list[Row]:
    keys, on = [end], []
    while keys[-1] != start:
        previous, ahead = came[keys[-1]]
        keys.append(previous)
        on.append(ahead)
    keys, on = keys[::-1], on[::-1]
    rows, first = [], keys[0]
    for key, following, ahead in zip(keys, keys[1:], on, strict=False):
        if ahead:
            rows.append((first, key))
            first = following
    return [*rows, (first, keys[-1])]


def extended(lanes: Map, rows: list[Row], before: float = BEFORE, beyond: float = BEYOND) -> list[Row]:
    """The way with lanelets before its first and beyond its last, straight on at forks, as far as the map goes."""
    rows, seen = list(rows), {key for row in rows for key in row}
    for ends, missing in ((True, beyond), (False, before)):
        while missing > 0.0:
            key = rows[-1][1] if ends else rows[0][0]
            others = lanes[key].successors if ends else lanes[key].predecessors
            others = [other for other in others if other in lanes and other not in seen]
            if not others:
                break
            bends = [_bend(lanes[key], lanes[other], ends) for other in others]
            nearest = others[int(np.argmin(bends))]
            seen.add(nearest)
            rows.insert(len(rows) if ends else 0, (nearest, nearest))
            missing -= lanes[nearest].length
    return rows


def _bend(one: Lanelet, other: Lanelet, ahead: bool) -> float:
    first, second = (one, other) if ahead else (other, one)
    a, b = first.centre[-1] - first.centre[-2], second.centre[-1] - second.centre[0]
    return abs(math.remainder(math.atan2(b[1], b[0]) - math.atan2(a[1], a[0]), math.tau))


def reference(lanes: Map, rows: list[Row], start: tuple[float, float], oncoming: bool) -> Array:
    """Points of the reference line and the width to both sides there: rows of x, y, left, right, in [m].

    Within a row in which the lane is changed the line goes over from one middle to the other. The road's edges are the
    outer bounds of all lanes that go the same way side by side, and of those that come towards it if `oncoming`.
    """
    parts = []
    for first, last in rows:
        line = lanes[first].centre if first == last else _change(lanes[first], lanes[last], start)
        line = _denser(line)
        left, right = (_edge(lanes, (first, last), side, oncoming) for side in ("left", "right"))
        points = shapely.points(line)
        parts.append(np.column_stack([line, shapely.distance(left, points), shapely.distance(right, points)]))
    joined = parts[0]
    for part in parts[1:]:
        if math.dist(joined[-1, :2], part[0, :2]) < 0.5:  # the joint is in both: the narrower of the two
            joined[-1, 2:] = np.minimum(joined[-1, 2:], part[0, 2:])
            part = part[1:]
        joined = np.vstack([joined, part])
    joined[:, 2:] = np.maximum(joined[:, 2:], 0.1)
    return joined


def _edge(lanes: Map, row: Row, side: str, oncoming: bool) -> shapely.LineString:
    """The outermost bound on a side of a row's lanes."""
    bounds = []
    for start in dict.fromkeys(row):
        key, same, seen = start, True, set()
        bound, other = getattr(lanes[key], side), "right" if side == "left" else "left"
        while key not in seen:
            seen.add(key)
            lane = lanes[key]
            neighbour = getattr(lane, f"{side if same else other}_of")
            if neighbour is None or neighbour[0] not in lanes or lanes[neighbour[0]].type in _NOT_FOR_CARS:
                break
            key, same = neighbour[0], same == neighbour[1]
            if not same and not oncoming:
                break
            bound = getattr(lanes[key], side) if same else getattr(lanes[key], other)[::-1]
        bounds.append(bound)
    middle = shapely.LineString(lanes[row[0]].centre)
    return shapely.LineString(max(bounds, key=lambda bound: middle.distance(shapely.Point(bound[len(bound) // 2]))))


_NOT_FOR_CARS = {"sidewalk", "crosswalk", "bicycleLane", "busLane", "restricted", "border"}


def _change(first: Lanelet, last: Lanelet, start: tuple[float, float]) -> Array:
    """From the middle of one lanelet to that of another beside it, beginning at the start if that is in here."""
    count = max(8, math.ceil(first.length / SAMPLE))
    a, b = _resampled(first.centre, count), _resampled(last.centre, count)
    line = shapely.LineString(a)
    begin = 0.0
    if first.polygon.distance(shapely.Point(*start)) < 1e-6:
        begin = float(shapely.line_locate_point(line, shapely.Point(*start))) / line.length
    share = np.clip((np.linspace(0.0, 1.0, count) - begin) / max(1.0 - begin, 1e-3), 0.0, 1.0)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return (1.0 - share[:, None]) * a + share[:, None] * b


def _resampled(line: Array, count: int) -> Array:
    stations = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    grid = np.linspace(0.0, stations[-1], count)
    return np.column_stack([np.interp(grid, stations, column) for column in line.T])


def _denser(line: Array) -> Array:
    """With points in between, on its chords, so that widths are known every few metres."""
    chords = np.hypot(*np.diff(line, axis=0).T)
    stations = np.concatenate([[0.0], np.cumsum(chords)])
    keep = np.concatenate([[True], chords > 1e-6])
    line, stations = line[keep], stations[keep]
    parts = [
        np.linspace(a, b, max(1, round((b - a) / (5.0 * SAMPLE))), endpoint=False)
        for a, b in pairwise(stations.tolist())
    ]
    grid = np.concatenate([*parts, stations[-1:]])
    return np.column_stack([np.interp(grid, stations, column) for column in line.T])
