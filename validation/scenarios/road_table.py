"""The table `road` of a scenario file: segments or way-points, and how wide the road is."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.ranges import Range
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc, Clothoid, Line
from sidestep.plant_models.road.waypoints import WayPoints
from sidestep.plant_models.road.widths import Widths
from sidestep.validation.scenarios.tables import built, checked, file_at, joined

SEGMENTS = {"line": Line, "arc": Arc, "clothoid": Clothoid}

Width = Annotated[float, Range(0.01, 1e3, "m")]


@dataclass
class RoadTable:
    """The table `road` of a scenario file: segments, or way-points.

    Attributes:
        width_left, width_right: From the reference to the road's edges, in [m]. May be left out if the way-points' file
            has columns w_left and w_right, and replace those if given.
        segments: Lines, arcs and clothoids, one after another.
        waypoints: CSV file with columns x and y, in [m], found from the scenario file's folder.
        points: The way-points themselves instead of a file: rows of x, y, or of x, y, width to the left, to the right,
            in [m].
        closed: Whether the end joins the start; found out if not given.
        smooth: How far the path may stray from the way-points so as to be smooth all along, in [m]. If not given it
            strays by 0.1 m at most, and is smoothed only where a spline would stray further.
    """

    width_left: Width | None = None
    width_right: Width | None = None
    segments: list[Any] = field(default_factory=list)
    waypoints: str = ""
    points: list[list[float]] = field(default_factory=list)
    closed: bool | None = None
    smooth: Annotated[float, Range(0.01, 100.0, "m")] | None = None


def road_path(table: dict[str, Any], folder: Path) -> ReferencePath:
    """The path of a scenario file's table `road`, with its widths.

    Raises:
        InputError: With the dotted key, or the way-points' file and line.
    """
    road = RoadTable(**checked(RoadTable, table, "road"))
    if sum(map(bool, (road.segments, road.waypoints, road.points))) != 1:
        raise InputError("road", "needs either segments or waypoints", "segments = [...], waypoints = FILE.csv, points")
    if road.segments and road.smooth is not None:
        raise InputError("road.smooth", "is for way-points: segments are exact")
    if road.waypoints:
        path = ReferencePath.from_csv(file_at(folder, road.waypoints, "road.waypoints"), road.closed, road.smooth)
    elif road.points:
        path = ReferencePath.through(_points(road), road.smooth)
    else:
        parts = [_segment(part, f"road.segments[{i}]") for i, part in enumerate(road.segments)]
        path = ReferencePath.from_segments(parts, closed=road.closed)
    return _with_widths(path, road)


def _points(road: RoadTable) -> WayPoints:
    for i, row in enumerate(road.points):
        if len(row) not in (2, 4) or len(row) != len(road.points[0]):
            raise InputError(f"road.points[{i}]", f"{len(row)} numbers", "x, y, or x, y, left, right; all rows alike")
    table = np.array(road.points, dtype=np.float64)
    sides = (table[:, 2], table[:, 3]) if table.shape[1] == 4 else (None, None)
    return WayPoints(table[:, :2], lambda i: f"road.points[{i}]", "road.points", *sides, closed=road.closed)


def _with_widths(path: ReferencePath, road: RoadTable) -> ReferencePath:
    has_own = path.given is not None and path.given.widths is not None
    for name in ("width_left", "width_right"):
        if getattr(road, name) is None and not has_own:
            raise InputError(f"road.{name}", "missing", "a number, or columns w_left and w_right of the way-points")
    if road.width_left is None and road.width_right is None:
        return path
    if has_own and (road.width_left is None or road.width_right is None):
        raise InputError("road", "one width is given here and both in the way-points' file", "both here, or none")
    assert road.width_left is not None
    assert road.width_right is not None
    return path.with_edges(Widths.constant(road.width_left, road.width_right))


def _segment(table: Any, where: str) -> Line | Arc | Clothoid:
    kind = table.get("type") if isinstance(table, dict) else None
    if kind not in SEGMENTS:
        raise InputError(joined(where, "type"), f"{kind!r}", ", ".join(SEGMENTS))
    values = {key: value for key, value in table.items() if key != "type"}
    return built(SEGMENTS[kind], values, where)
