"""What is wrong with an FMU and its mapping together: found by driving it, in a process of its own."""

import math
from functools import partial
from pathlib import Path

from sidestep.fmu.importing.archive import describe_fmu
from sidestep.fmu.importing.isolation import IsolatedPlant
from sidestep.fmu.importing.mapping import OUTPUTS, Mapping
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.plant_models.checks.check_plant import check_plant
from sidestep.plant_models.checks.driving import DT
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.vehicle.table import vehicle_from_table

TIME_LIMIT = 10.0
"""For one call of the FMU, in [s]."""


def check_driven(path: Path, map_file: Path) -> list[str]:
    """Drive an FMU by its mapping through the manoeuvres of `check_plant`.

    The car is the mapping's `[vehicle]`; without one, what only a known car shows is not looked for, which is said.

    Returns:
        One sentence for every finding.

    Raises:
        InputError: The mapping file cannot be used.
    """
    mapping = Mapping.from_file(map_file)
    vehicle = vehicle_from_table(mapping.vehicle) if mapping.vehicle else None
    try:
        step = _step(path)
        with IsolatedPlant(partial(FmuPlant.from_file, path, mapping, vehicle), TIME_LIMIT) as plant:
            found = check_plant(plant, vehicle, step, ("time", *(name for name in OUTPUTS if name in mapping.start)))
    except (InputError, PlantError) as error:
        return [str(error)]
    if vehicle is None:
        found.append(
            "No [vehicle] in the mapping: ratio, reference point, steering and tyres are compared with no car."
        )
    return found


def _step(path: Path) -> float:
    """Twice a step that the FMU can make, about DT."""
    fmu = describe_fmu(path)
    return 2.0 * fmu.fixed_step * math.ceil(0.5 * DT / fmu.fixed_step - 1e-9) if fmu.fixed_step else DT
