"""Scenarios: what is driven, as one checked value, from a TOML file and `--set` overrides."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from sidestep.controller import ControllerConfig
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc, Clothoid, Line
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.tyres.property_file import read_tyre
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.judge.geometry import car_boxes, edge_clearance, obstacle_boxes, signed_clearance
from sidestep.validation.scenarios.plant_settings import PlantSettings, plant_settings
from sidestep.validation.scenarios.tables import built, checked, did_you_mean, file_at, joined, override

_BUILT_IN = Path(__file__).parent / "built_in"
_SEGMENTS = {"line": Line, "arc": Arc, "clothoid": Clothoid}

Positive = Annotated[float, Meta(gt=0.0)]


@dataclass(frozen=True)
class Scenario:
    """One drive: road, obstacles, car, controller and plant.

    Attributes:
        name: Used for the names of output folders.
        speed: Speed to hold, in [m/s].
        duration: Simulated time at most, in [s].
        path: Reference path.
        start: State at time 0.
        obstacles: Boxes in the road frame.
        vehicle: The car, as the controller knows it.
        controller: Its configuration, the road's widths included.
        controller_preset: Name of the configuration that it started from.
        description: One line for lists.
        plant: Which plant.
        tables: The file's tables after the overrides: what makes the same run again.
        folder: From which the files in them are found.
    """

    name: str
    speed: float
    duration: float
    path: ReferencePath
    start: VehicleState
    obstacles: tuple[Obstacle, ...]
    vehicle: VehicleParameters
    controller: ControllerConfig
    controller_preset: str = "default"
    description: str = ""
    plant: PlantSettings = field(default_factory=PlantSettings)
    tables: dict[str, Any] = field(default_factory=dict, compare=False)
    folder: Path = field(default=Path(), compare=False)


@dataclass
class _File:
    name: Annotated[str, Meta(pattern=r"^[\w.-]+$")]
    speed: Positive
    duration: Positive
    road: dict[str, Any]
    description: str = ""
    start: dict[str, Any] = field(default_factory=dict)
    obstacles: list[Any] = field(default_factory=list)
    vehicle: dict[str, Any] = field(default_factory=dict)
    controller: dict[str, Any] = field(default_factory=dict)
    plant: dict[str, Any] = field(default_factory=dict)


@dataclass
class _Road:
    width_left: Positive
    width_right: Positive
    segments: list[Any] = field(default_factory=list)
    waypoints: str = ""


@dataclass
class _Start:
    s: float = 0.0
    l: float = 0.0  # noqa: E741 (the paper's letter)
    heading: float = 0.0
    speed: Positive | None = None


def built_in_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that come with the package."""
    return tuple(sorted(file.stem for file in _BUILT_IN.glob("*.toml")))


def load_scenario(name_or_path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario.

    Args:
        name_or_path: One of `built_in_scenarios()`, or a TOML file.
        overrides: `key=value` with dotted keys, as given to `--set`.

    Raises:
        InputError: With file, dotted key and what is allowed.
    """
    file, text = read_scenario(name_or_path)
    return parse_scenario(text, str(name_or_path), overrides, file)


def read_scenario(name_or_path: str | Path, folder: Path = Path()) -> tuple[Path, str]:
    """File and text of a scenario; a built-in one stands as if in `folder`, for the files that overrides name.

    Args:
        name_or_path: One of `built_in_scenarios()`, or a TOML file.
        folder: From which the file is found.

    Raises:
        InputError: There is none, or it cannot be read.
    """
    name, known = str(name_or_path), built_in_scenarios()
    if name in known:
        return folder / f"{name}.toml", (_BUILT_IN / f"{name}.toml").read_text(encoding="utf-8")
    file = folder / name
    if not file.is_file():
        problem = f"no built-in scenario and no file {name!r}{did_you_mean(name, known)}"
        raise InputError("scenario", problem, f"{', '.join(known)}, or a TOML file")
    try:
        return file, file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(file), f"no readable TOML file ({error})") from error


def parse_scenario(
    text: str, label: str, overrides: Sequence[str] = (), file: Path = Path("scenario.toml")
) -> Scenario:
    """A scenario from the text of its file.

    Args:
        text: TOML.
        label: What errors call it.
        overrides: `key=value` with dotted keys, as given to `--set`.
        file: Where it stands: other files are found from its folder.

    Raises:
        InputError: With label, dotted key and what is allowed.
    """
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(label, f"no readable TOML file ({error})") from error
    for change in overrides:
        override(tables, change)
    return scenario_from_tables(tables, label, file)


def scenario_from_tables(tables: dict[str, Any], label: str, file: Path) -> Scenario:
    """A scenario from the tables of its file, overrides included; see `parse_scenario`."""
    try:
        return _scenario(tables, file)
    except InputError as error:
        raise InputError(f"{label}: {error.where}", error.problem, error.allowed) from error


def _scenario(tables: dict[str, Any], file: Path) -> Scenario:
    top = _File(**checked(_File, {"name": file.stem, **tables}))
    road = _Road(**checked(_Road, top.road, "road"))
    start = _Start(**checked(_Start, top.start, "start"))
    path = _path(road, file.parent)
    preset, config = _controller(top.controller, road, top.speed)
    x, y = path.to_cartesian(start.s, start.l)
    yaw = path.heading(start.s) + start.heading
    scenario = Scenario(
        name=top.name,
        speed=top.speed,
        duration=top.duration,
        path=path,
        start=VehicleState(0.0, x, y, yaw, start.speed or top.speed),
        obstacles=tuple(_obstacle(values, f"obstacles[{i}]") for i, values in enumerate(top.obstacles)),
        vehicle=_vehicle(top.vehicle, file.parent),
        controller=config,
        controller_preset=preset,
        description=top.description,
        plant=plant_settings(top.plant, file.parent),
        tables=tables,
        folder=file.parent,
    )  # fmt: skip
    _check_start(scenario, start.s)
    return scenario


def _path(road: _Road, folder: Path) -> ReferencePath:
    if bool(road.segments) == bool(road.waypoints):
        raise InputError("road", "needs either segments or waypoints", "segments = [...] or waypoints = FILE.csv")
    if road.waypoints:
        return ReferencePath.from_csv(file_at(folder, road.waypoints, "road.waypoints"))
    return ReferencePath.from_segments(
        [_segment(table, f"road.segments[{i}]") for i, table in enumerate(road.segments)]
    )


def _segment(table: Any, where: str) -> Line | Arc | Clothoid:
    kind = table.get("type") if isinstance(table, dict) else None
    if kind not in _SEGMENTS:
        raise InputError(joined(where, "type"), f"{kind!r}", ", ".join(_SEGMENTS))
    values = {key: value for key, value in table.items() if key != "type"}
    return built(_SEGMENTS[kind], values, where)


def _obstacle(table: Any, where: str) -> Obstacle:
    return built(Obstacle, table, where)


def _vehicle(table: dict[str, Any], folder: Path) -> VehicleParameters:
    names = {"preset": str, "file": str, "tyre_file": str}
    values = checked(VehicleParameters, table, "vehicle", partial=True, also=names)
    preset, file, tyre_file = values.pop("preset", "bmw-320i"), values.pop("file", ""), values.pop("tyre_file", "")
    base = VehicleParameters.preset(preset)
    if file:
        base = VehicleParameters.from_file(file_at(folder, file, "vehicle.file"))
    if tyre_file:
        base = base.with_(tyre=read_tyre(file_at(folder, tyre_file, "vehicle.tyre_file")))
    for name in ("tyre", "suspension"):
        if name in values:
            values[name] = replace(getattr(base, name), **values[name])
    return base.with_(**values)


def _controller(table: dict[str, Any], road: _Road, speed: float) -> tuple[str, ControllerConfig]:
    elsewhere = {"width_left": road.width_left, "width_right": road.width_right, "cruise_speed": speed}
    values = checked(ControllerConfig, table, "controller", partial=True, also={"preset": str}, without=elsewhere)
    preset = values.pop("preset", "default")
    return preset, ControllerConfig.preset(preset, **elsewhere, **values)


def _check_start(scenario: Scenario, s: float) -> None:
    start, path = scenario.start, scenario.path
    if not 0.0 <= s <= path.length:
        raise InputError("start.s", f"{s} m is not on the road", f"0 to {path.length:.3f}")
    box = car_boxes(scenario.vehicle, start.x, start.y, start.yaw)
    config = scenario.controller
    if (edge := float(edge_clearance(path, config.width_left, config.width_right, box, np.array([s]))[0])) < 0.0:
        raise InputError(
            "start.l", f"the car stands {-edge:.2f} m over the road's edge", "all four corners on the road"
        )
    for index, obstacle in enumerate(scenario.obstacles):
        gap = float(signed_clearance(box, obstacle_boxes(path, obstacle, np.zeros(1)))[0])
        if gap <= 0.0:
            raise InputError(f"obstacles[{index}]", "stands on the start of the car", "a free start")
