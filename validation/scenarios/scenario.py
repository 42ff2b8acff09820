"""Scenarios: what is driven, as one checked value, from a TOML file and `--set` overrides."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from sidestep.controller import ControllerConfig
from sidestep.plant_models.documents import toml_tables
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.notebook import facts_table
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.ranges import Range
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters, require_one_stiffness
from sidestep.plant_models.vehicle.table import vehicle_from_table
from sidestep.validation.geometry import car_boxes, edge_clearance, obstacle_boxes, signed_clearance
from sidestep.validation.scenarios.goal import Goal, goal
from sidestep.validation.scenarios.library import read_scenario
from sidestep.validation.scenarios.own_car import own_car, told_car
from sidestep.validation.scenarios.plant_settings import PlantSettings, plant_settings
from sidestep.validation.scenarios.readers.formats import ENDINGS, read_foreign
from sidestep.validation.scenarios.road_table import road_path
from sidestep.validation.scenarios.tables import Name, checked, file_at, override, overrides_of
from sidestep.validation.scenarios.traffic import obstacle, placed

ELSEWHERE = ("width_left", "width_right", "cruise_speed")
"""Settings of the controller that the tables of road and scenario hold."""

Speed = Annotated[float, Range(0.01, 150.0, "m/s")]


@dataclass(frozen=True, repr=False)
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
        controller_kind: `module:factory` of somebody else's controller; empty for ours.
        description: One line for lists.
        plant: Which plant.
        goal: Where, when and how it ends before its time; None for nowhere.
        notes: What was put right, smoothed, assumed or left out on the way from the file to this.
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
    controller_kind: str = ""
    description: str = ""
    plant: PlantSettings = field(default_factory=PlantSettings)
    goal: Goal | None = None
    notes: tuple[str, ...] = ()
    tables: dict[str, Any] = field(default_factory=dict, compare=False)
    folder: Path = field(default=Path(), compare=False)

    def __repr__(self) -> str:
        count = len(self.obstacles)
        boxes = f"{count} obstacle{'' if count == 1 else 's'}"
        return f"Scenario({self.name!r}, {self.speed:g} m/s, {self.duration:g} s, {boxes}, on {self.plant.name})"

    def _repr_html_(self) -> str:
        facts = [
            ("description", self.description), ("speed", f"{self.speed:g} m/s"), ("duration", f"{self.duration:g} s"),
            ("road", f"{self.path.length:.1f} m"), ("obstacles", len(self.obstacles)), ("car", self.vehicle.name),
            ("controller", self.controller_preset), ("plant", self.plant.name),
        ]  # fmt: skip
        return facts_table(f"Scenario {self.name}", facts)


@dataclass
class ScenarioTables:
    """A scenario file: one drive.

    Attributes:
        name: Used for the names of output folders; letters, digits, `_`, `.`, `-`. The file's own if not given.
        speed: To be held, in [m/s].
        duration: Simulated time at most, in [s].
        road: Table, see `road`.
        description: One line for lists.
        start: Table, see `start`.
        obstacles: List of tables, see `obstacles[]`.
        vehicle: Table, see `vehicle`.
        controller: Table, see `controller`.
        plant: Table, see `plant`.
        goal: Table, see `goal`.
    """

    name: Name
    speed: Speed
    duration: Annotated[float, Range(0.001, 1e5, "s")]
    road: dict[str, Any]
    description: str = ""
    start: dict[str, Any] = field(default_factory=dict)
    obstacles: list[Any] = field(default_factory=list)
    vehicle: dict[str, Any] = field(default_factory=dict)
    controller: dict[str, Any] = field(default_factory=dict)
    plant: dict[str, Any] = field(default_factory=dict)
    goal: dict[str, Any] | None = None


@dataclass
class StartTable:
    """The table `start` of a scenario file: the car's reference point at time 0.

    Attributes:
        s, l: Along the road's reference (of way-points: along their polyline) and to the left of it, in [m].
        heading: Relative to the road's direction there, in [rad].
        speed: Of the reference point, in [m/s]; that to hold if not given.
        sideslip: Direction of that speed relative to the heading, in [rad].
        yaw_rate: In [rad/s].
    """

    s: Annotated[float, Range(-1e6, 1e6, "m")] = 0.0
    l: Annotated[float, Range(-1e3, 1e3, "m")] = 0.0  # noqa: E741 (the paper's letter)
    heading: Annotated[float, Range(-100.0, 100.0, "rad")] = 0.0
    speed: Annotated[float, Range(0.0, 150.0, "m/s")] | None = None
    sideslip: Annotated[float, Range(-1.5, 1.5, "rad")] = 0.0
    yaw_rate: Annotated[float, Range(-10.0, 10.0, "rad/s")] = 0.0


def load_scenario(name_or_path: str | Path, overrides: Sequence[str] = (), /, **values: Any) -> Scenario:
    """Read a scenario.

    Args:
        name_or_path: One of `built_in_scenarios()`, a TOML file, a CommonRoad .xml or an OpenSCENARIO .xosc file.
        overrides: `key=value` with dotted keys, as given to `--set`.
        values: The same as Python's values: `speed=17.0`, a table by its keys, `plant={"friction": 0.6}`, or a dotted
            key, `**{"obstacles.0.l": 0.5}`.

    Raises:
        InputError: With file, dotted key and what is allowed.
    """
    overrides = [*overrides, *overrides_of(values)]
    if (foreign := Path(name_or_path)).suffix.lower() in ENDINGS and foreign.is_file():
        own = {key: value for change in overrides for key, value in _parameter(change)}
        imported = read_foreign(foreign, own)
        for change in overrides:
            if not _parameter(change):
                override(imported.tables, change)
        return scenario_from_tables(imported.tables, str(name_or_path), foreign, imported.notes)
    file, text = read_scenario(name_or_path)
    return parse_scenario(text, str(name_or_path), overrides, file)


def _parameter(change: str) -> list[tuple[str, str]]:
    """Name and value of an override `parameters.NAME=VALUE`; empty if it is another one."""
    key, separator, value = change.partition("=")
    prefix, dot, name = key.strip().partition(".")
    return [(name, value.strip())] if separator and dot and prefix == "parameters" else []


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
    tables = toml_tables(text, label)
    for change in overrides:
        override(tables, change)
    return scenario_from_tables(tables, label, file)


def scenario_from_tables(tables: dict[str, Any], label: str, file: Path, notes: Sequence[str] = ()) -> Scenario:
    """A scenario from the tables of its file, overrides included; see `parse_scenario`."""
    try:
        scenario = _scenario(tables, file)
        return replace(scenario, notes=(*notes, *scenario.path.notes))
    except InputError as error:
        raise InputError(f"{label}: {error.where}", error.problem, error.allowed) from error


def _scenario(tables: dict[str, Any], file: Path) -> Scenario:
    top = ScenarioTables(**checked(ScenarioTables, {"name": file.stem, **tables}))
    start = StartTable(**checked(StartTable, top.start, "start"))
    path = road_path(top.road, file.parent)
    kind, preset, config = _controller(top.controller, path, top.speed)
    obstacles = (obstacle(values, f"obstacles[{i}]", path, file.parent) for i, values in enumerate(top.obstacles))
    x, y, yaw = placed(path, start.s, start.l, start.heading)
    speed = top.speed if start.speed is None else start.speed
    v_x, v_y = speed * math.cos(start.sideslip), speed * math.sin(start.sideslip)
    plant = plant_settings(top.plant, file.parent)
    told = told_car(top.vehicle, plant)
    scenario = Scenario(
        name=top.name,
        speed=top.speed,
        duration=top.duration,
        path=path,
        start=VehicleState(0.0, x, y, yaw, v_x, v_y, start.yaw_rate),
        obstacles=tuple(obstacles),
        goal=goal(top.goal, path),
        vehicle=_vehicle(told, file.parent, own_car(told, plant, top.speed)),
        controller=config,
        controller_preset=preset,
        controller_kind=kind,
        description=top.description,
        plant=plant,
        tables=tables,
        folder=file.parent,
    )  # fmt: skip
    _check_start(scenario, start.s)
    return scenario


def _vehicle(table: dict[str, Any], folder: Path, known: VehicleParameters | None) -> VehicleParameters:
    require_one_stiffness(table)
    names = {"preset": str, "file": str, "tyre_file": str}
    values = checked(VehicleParameters, table, "vehicle", partial=True, also=names)
    for key in ("file", "tyre_file"):
        if values.get(key):
            file_at(folder, values[key], f"vehicle.{key}")
    return vehicle_from_table(values, folder, known)


def _controller(table: dict[str, Any], path: ReferencePath, speed: float) -> tuple[str, str, ControllerConfig]:
    elsewhere = dict(zip(ELSEWHERE, (*path.edges.narrowest, speed), strict=True))
    names = {"preset": str, "kind": str}
    values = checked(ControllerConfig, table, "controller", partial=True, also=names, without=ELSEWHERE)
    preset, kind = values.pop("preset", "default"), values.pop("kind", "")
    if kind and ":" not in kind:
        raise InputError("controller.kind", f"{kind!r}", "module:factory, or nothing for ours")
    return kind, preset, ControllerConfig.preset(preset, **elsewhere, **values)


def _check_start(scenario: Scenario, s: float) -> None:
    start, path = scenario.start, scenario.path
    length = path.given.length if path.given else path.length
    if not 0.0 <= s <= length:
        raise InputError("start.s", f"{s} m is not on the road", f"0 to {length:.3f}")
    box = car_boxes(scenario.vehicle, start.x, start.y, start.yaw)
    if (edge := float(edge_clearance(path, box, path.station_of([s]))[0])) < 0.0:
        raise InputError(
            "start.l", f"the car stands {-edge:.2f} m over the road's edge", "all four corners on the road"
        )
    for index, other in enumerate(scenario.obstacles):
        gap = float(signed_clearance(box, obstacle_boxes(path, other, np.zeros(1)))[0])
        if gap <= 0.0:
            raise InputError(f"obstacles[{index}]", "stands on the start of the car", "a free start")
