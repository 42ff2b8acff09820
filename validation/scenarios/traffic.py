"""Obstacles of a scenario file: boxes that stand, go at constant speed along the road, or follow a trajectory."""

import math
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import FOREVER, Obstacle
from sidestep.plant_models.ranges import Range
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.trajectory import Array, Trajectory
from sidestep.validation.scenarios.tables import built, checked, file_at

Size = Annotated[float, Range(0.001, 1e4, "m")]
Time = Annotated[float, Range(-FOREVER, FOREVER, "s")]


@dataclass
class TrajectoryTable:
    """The table `obstacles.trajectory`: poses of the box's centre over time, linear in between.

    Attributes:
        frame: What the poses are given in: the road (s, l, heading relative to it) or the world (x, y, heading).
        file: CSV file with the columns t, and s, l or x, y, and heading if it has one, instead of the lists here.
        t: Times, in [s], ascending.
        s, l: Centre in the road frame, in [m].
        x, y: Centre in the world, in [m].
        heading: Relative to the road, or in the world, in [rad]; that of the motion if not given.
    """

    frame: Literal["road", "world"] = "road"
    file: str = ""
    t: list[float] = field(default_factory=list)
    s: list[float] = field(default_factory=list)
    l: list[float] = field(default_factory=list)  # noqa: E741
    x: list[float] = field(default_factory=list)
    y: list[float] = field(default_factory=list)
    heading: list[float] = field(default_factory=list)


@dataclass
class ObstacleTable:
    """One of the tables `obstacles` of a scenario file.

    Attributes:
        s, l: Arc length along the road's reference (of way-points: along their polyline) and offset to the left, of
            the centre at time 0, in [m].
        length, width: Size along and across its own heading, in [m].
        heading: Relative to the road's direction at s, in [rad].
        speed: Along the road at constant l, in [m/s].
        height: In [m].
        appears, vanishes: When it comes and goes, in [s].
        trajectory: Its motion, instead of s, l, heading and speed.
        note: What the box stands for, such as the outline that it bounds.
    """

    length: Size
    width: Size
    s: Annotated[float, Range(-1e6, 1e6, "m")] | None = None
    l: Annotated[float, Range(-1e4, 1e4, "m")] | None = None  # noqa: E741
    heading: Annotated[float, Range(-100.0, 100.0, "rad")] = 0.0
    speed: Annotated[float, Range(-150.0, 150.0, "m/s")] = 0.0
    height: Annotated[float, Range(0.001, 100.0, "m")] = 1.5
    appears: Time = 0.0
    vanishes: Time = FOREVER
    trajectory: dict[str, Any] | None = None
    note: str = ""


def placed(path: ReferencePath, s: float, l: float, heading: float) -> tuple[float, float, float]:  # noqa: E741
    """World pose x, y, yaw of road coordinates as a scenario file gives them.

    On a road of way-points they count along their polyline, which is what the author knows; on one of segments along
    the path, which is exact.
    """
    if path.given is None:
        return *path.to_cartesian(s, l), path.heading(s) + heading
    (x,), (y,) = path.given.beside(s, l)
    return float(x), float(y), float(path.given.heading(s)[0]) + heading


def on_path(path: ReferencePath, s: float, l: float, heading: float) -> tuple[float, float, float]:  # noqa: E741
    """Coordinates in the frame of the smooth path of what a scenario file gives in the frame of its way-points."""
    if path.given is None:
        return s, l, heading
    x, y, yaw = placed(path, s, l, heading)
    station, offset, road = path.project(x, y, float(path.station_of(s)))
    return station, offset, math.remainder(yaw - road, math.tau)


def obstacle(table: Any, where: str, path: ReferencePath, folder: Path) -> Obstacle:
    """One obstacle of a scenario file.

    Raises:
        InputError: With the dotted key.
    """
    for key in ("s", "l"):
        if isinstance(table, dict) and key not in table and "trajectory" not in table:
            raise InputError(f"{where}.{key}", "missing")
    row = ObstacleTable(**checked(ObstacleTable, table, where))
    if row.trajectory is not None:
        for key in ("s", "l", "heading", "speed"):
            if key in table:
                raise InputError(f"{where}.{key}", "is given together with a trajectory", "one of them")
        motion = _trajectory(row.trajectory, f"{where}.trajectory", path, folder)
        return Obstacle.along(motion, row.length, row.width, row.height, row.appears, row.vanishes)
    assert row.s is not None
    assert row.l is not None
    s, l, heading = on_path(path, row.s, row.l, row.heading)  # noqa: E741
    values = {"s": s, "l": l, "heading": heading, "speed": row.speed, "height": row.height, "vanishes": row.vanishes}
    return built(Obstacle, {"length": row.length, "width": row.width, "appears": row.appears, **values}, where)


def _trajectory(table: Any, where: str, path: ReferencePath, folder: Path) -> Trajectory:
    row = TrajectoryTable(**checked(TrajectoryTable, table, where))
    names = ("s", "l") if row.frame == "road" else ("x", "y")
    if row.file:
        columns = _columns(file_at(folder, row.file, f"{where}.file"), ("t", *names))
    else:
        columns = {name: np.array(getattr(row, name)) for name in ("t", *names, "heading")}
    time, first, second = (columns[name] for name in ("t", *names))
    for name in ("t", *names):
        if len(columns[name]) != len(time) or len(time) == 0:
            raise InputError(f"{where}.{name}", f"{len(columns[name])} values", f"{max(len(time), 1)}, as t has")
    heading = columns.get("heading", np.empty(0))
    if len(heading) not in (0, len(time)):
        raise InputError(f"{where}.heading", f"{len(heading)} values", f"{len(time)}, or none")
    try:
        if row.frame == "road" and path.given is None:
            return Trajectory(time, first, second, heading if len(heading) else _direction(first, second, 0.0))
        if row.frame == "road":
            first, second, heading = _in_world(path, first, second, heading)
        else:
            first, second = first - path.origin[0], second - path.origin[1]
        return Trajectory.in_world(path, time, first, second, heading if len(heading) else _direction(first, second))
    except InputError as error:
        raise InputError(where, error.problem, error.allowed) from error


def _in_world(path: ReferencePath, s: Array, l: Array, heading: Array) -> tuple[Array, Array, Array]:  # noqa: E741
    poses = [placed(path, *row) for row in zip(s, l, heading if len(heading) else np.zeros_like(s), strict=True)]
    x, y, yaw = np.array(poses).T
    return x, y, yaw if len(heading) else np.empty(0)


def _direction(first: Array, second: Array, still: Annotated[float, Range(-1e4, 1e4, "m")] | None = None) -> Array:
    """Of the motion; that before and after where it stands, `still` (or 0) where it never moves."""
    if len(first) < 2:
        return np.full(len(first), still or 0.0)
    steps = np.diff(first), np.diff(second)
    moving = np.hypot(*steps) > 1e-3
    if not moving.any():
        return np.full(len(first), still or 0.0)
    angles = np.unwrap(np.arctan2(steps[1][moving], steps[0][moving]))
    if still is not None:  # a car that backs along the road does not turn round
        angles = np.where(np.abs(np.remainder(angles + math.pi, math.tau) - math.pi) > 0.5 * math.pi, still, angles)
    return np.interp(np.arange(len(first)), np.flatnonzero(moving), angles)


def _columns(file: Path, names: tuple[str, ...]) -> dict[str, Array]:
    try:
        with open(file, encoding="utf-8-sig") as stream:
            head = [cell.strip(' "#\n').partition(" ")[0].lower() for cell in stream.readline().split(",")]
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # of a file without data
                values = np.loadtxt(stream, delimiter=",", ndmin=2)
    except (OSError, ValueError, UserWarning) as error:
        raise InputError(str(file), f"no table of numbers ({error})", ", ".join(names)) from error
    for name in names:
        if name not in head:
            raise InputError(str(file), f"no column {name!r}", ", ".join(names))
    return {name: values[:, i] for i, name in enumerate(head) if i < values.shape[1]}
