"""Scenarios: what is driven, as one checked value, from a TOML file and `--set` overrides."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from sidestep.controller import ControllerConfig
from sidestep.fmu.importing.mapping import vehicle_table
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.ranges import Range
from sidestep.plant_models.road.reference_path import Arc, Clothoid, Line, ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters, require_one_stiffness
from sidestep.plant_models.vehicle.table import WHOLE, vehicle_from_table
from sidestep.validation.geometry import car_boxes, edge_clearance, obstacle_boxes, signed_clearance
from sidestep.validation.scenarios.library import read_scenario
from sidestep.validation.scenarios.plant_settings import PlantSettings, plant_settings
from sidestep.validation.scenarios.tables import built, checked, file_at, joined, override

_SEGMENTS = {"line": Line, "arc": Arc, "clothoid": Clothoid}

ELSEWHERE = ("width_left", "width_right", "cruise_speed")
"""Settings of the controller that the tables of road and scenario hold."""

Speed = Annotated[float, Range(0.01, 150.0, "m/s")]
Width = Annotated[float, Range(0.01, 1e3, "m")]


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
class TopLevel:
    """The keys of a scenario file."""

    name: Annotated[str, Meta(pattern=r"^[\w.-]+$")]
    speed: Speed
    duration: Annotated[float, Range(0.001, 1e5, "s")]
    road: dict[str, Any]
    description: str = ""
    start: dict[str, Any] = field(default_factory=dict)
    obstacles: list[Any] = field(default_factory=list)
    vehicle: dict[str, Any] = field(default_factory=dict)
    controller: dict[str, Any] = field(default_factory=dict)
    plant: dict[str, Any] = field(default_factory=dict)


@dataclass
class Road:
    """The table `road` of a scenario file."""

    width_left: Width
    width_right: Width
    segments: list[Any] = field(default_factory=list)
    waypoints: str = ""


@dataclass
class Start:
    """The table `start` of a scenario file: at time 0, in the road frame."""

    s: Annotated[float, Range(-1e6, 1e6, "m")] = 0.0
    l: Annotated[float, Range(-1e3, 1e3, "m")] = 0.0  # noqa: E741 (the paper's letter)
    heading: Annotated[float, Range(-100.0, 100.0, "rad")] = 0.0
    speed: Speed | None = None


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
    top = TopLevel(**checked(TopLevel, {"name": file.stem, **tables}))
    road = Road(**checked(Road, top.road, "road"))
    start = Start(**checked(Start, top.start, "start"))
    path = _path(road, file.parent)
    preset, config = _controller(top.controller, road, top.speed)
    x, y = path.to_cartesian(start.s, start.l)
    yaw = path.heading(start.s) + start.heading
    plant = plant_settings(top.plant, file.parent)
    scenario = Scenario(
        name=top.name,
        speed=top.speed,
        duration=top.duration,
        path=path,
        start=VehicleState(0.0, x, y, yaw, start.speed or top.speed),
        obstacles=tuple(_obstacle(values, f"obstacles[{i}]") for i, values in enumerate(top.obstacles)),
        vehicle=_vehicle(told_car(top.vehicle, plant), file.parent),
        controller=config,
        controller_preset=preset,
        description=top.description,
        plant=plant,
        tables=tables,
        folder=file.parent,
    )  # fmt: skip
    _check_start(scenario, start.s)
    return scenario


def _path(road: Road, folder: Path) -> ReferencePath:
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
    require_one_stiffness(table)
    names = {"preset": str, "file": str, "tyre_file": str}
    values = checked(VehicleParameters, table, "vehicle", partial=True, also=names)
    for key in ("file", "tyre_file"):
        if values.get(key):
            file_at(folder, values[key], f"vehicle.{key}")
    return vehicle_from_table(values, folder)


def told_car(vehicle: dict[str, Any], plant: PlantSettings) -> dict[str, Any]:
    """The table `vehicle` of a scenario, on that of the mapping file of its plant unless it tells a whole car."""
    if not plant.map or not Path(plant.map).is_file() or any(key in vehicle for key in WHOLE):
        return vehicle
    return vehicle_table(Path(plant.map)) | vehicle


def _controller(table: dict[str, Any], road: Road, speed: float) -> tuple[str, ControllerConfig]:
    elsewhere = dict(zip(ELSEWHERE, (road.width_left, road.width_right, speed), strict=True))
    values = checked(ControllerConfig, table, "controller", partial=True, also={"preset": str}, without=ELSEWHERE)
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
