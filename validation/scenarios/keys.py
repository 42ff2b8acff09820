"""Every key of a scenario file that holds a number, with what it takes."""

from collections.abc import Iterator
from dataclasses import MISSING, fields
from typing import Any, NamedTuple

from sidestep.controller import ControllerConfig
from sidestep.plant_models.mujoco.surface import FrictionPatch
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.ranges import Range, bounded_fields
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.vehicle.parameters import SuspensionParameters, VehicleParameters
from sidestep.validation.scenarios.plant_settings import Heights, PlantSettings
from sidestep.validation.scenarios.scenario import ELSEWHERE, Road, Start, TopLevel

TABLES: dict[str, type] = {
    "": TopLevel,
    "road": Road,
    "start": Start,
    "obstacles[]": Obstacle,
    "vehicle": VehicleParameters,
    "vehicle.tyre": TyreParameters,
    "vehicle.suspension": SuspensionParameters,
    "controller": ControllerConfig,
    "plant": PlantSettings,
    "plant.patches[]": FrictionPatch,
    "plant.heights": Heights,
}
"""The dataclass of each table; `[]` stands for every entry of a list."""


class Key(NamedTuple):
    """A key that holds a number.

    Attributes:
        path: Dotted, `[]` for every entry of a list.
        default: None if there is none or it depends on other keys.
        range: What it takes.
    """

    path: str
    default: Any
    range: Range


def numeric_keys() -> Iterator[Key]:
    """All keys of a scenario file that hold a number, table by table."""
    for table, cls in TABLES.items():
        defaults = {f.name: None if f.default is MISSING else f.default for f in fields(cls)}
        for name, limits, *_ in bounded_fields(cls):
            if not (table == "controller" and name in ELSEWHERE):
                yield Key(f"{table}.{name}".lstrip("."), defaults[name], limits)
