"""The quick check of a plant that is not ours, in a process of its own before the drive.

What would make the drive worthless (a turned sign, a wrong unit, a ratio not told) is refused; what only looks odd (the
car turns a quarter more or less than the one that is told) is a warning. In a process of its own, because some FMUs can
be instantiated but once in each, and because what crashes there does not end the command.
"""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

from sidestep.plant_models.checks.quick import quick_check
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.vehicle.table import WHOLE
from sidestep.validation.loop.cosimulation import PLANT_STEP
from sidestep.validation.scenarios.own_car import told_car
from sidestep.validation.scenarios.plant_settings import PlantSettings
from sidestep.validation.scenarios.scenario import Scenario
from sidestep.validation.scenarios.tables import file_at

TIME_LIMIT = 30.0
"""For one call of the plant, in [s]."""


def is_foreign(settings: PlantSettings) -> bool:
    """Whether the plant is somebody else's FMU."""
    return settings.kind.endswith(".fmu")


def plant_doubts(scenario: Scenario, build: Callable[[], Plant] | None = None) -> list[str]:
    """What looks odd about a foreign plant, as sentences; none of ours is driven.

    Args:
        scenario: Its plant, car, start and period.
        build: Makes the plant; must be picklable. None for the scenario's.

    Raises:
        InputError: The plant cannot be used, or what it does contradicts its mapping.
        PlantError: It cannot start or go on.
    """
    settings = scenario.plant
    if settings.kind.endswith(".xml"):
        from sidestep.validation.loop.model_doubts import model_doubts

        return model_doubts(scenario)
    if not is_foreign(settings):
        return []
    from sidestep.fmu.importing.isolation import IsolatedPlant
    from sidestep.fmu.importing.plant import FmuPlant

    mapping = file_at(Path(), settings.map, "plant.map") if settings.map else None
    make = build or partial(FmuPlant.from_file, Path(settings.kind), mapping, scenario.vehicle, settings.friction)
    period = scenario.controller.period
    step = period / max(1, math.ceil(period / PLANT_STEP - 1e-9))
    with IsolatedPlant(make, settings.isolate or TIME_LIMIT) as plant:
        doubts = quick_check(plant, scenario.vehicle, scenario.start, step)
    if certain := [doubt.sentence for doubt in doubts if doubt.is_certain]:
        look = f"`sidestep fmu check {Path(settings.kind).name} --map MAP.toml` looks closer"
        raise InputError(settings.map or settings.kind, f"a first bend contradicts it: {'; '.join(certain)}", look)
    return [doubt.sentence + _whose(scenario) for doubt in doubts]


def _whose(scenario: Scenario) -> str:
    told = told_car(scenario.tables.get("vehicle", {}), scenario.plant)
    return "" if any(key in told for key in WHOLE) else " (the default car: [vehicle] in the mapping file tells which)"
