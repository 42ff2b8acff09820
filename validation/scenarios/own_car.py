"""The car that a plant says it is, where nobody tells another."""

from functools import lru_cache
from pathlib import Path
from typing import Any

from sidestep.fmu.importing.mapping import vehicle_table
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.plant_models.vehicle.table import WHOLE
from sidestep.validation.scenarios.plant_settings import PlantSettings

_Stamp = tuple[str, int]


def told_car(vehicle: dict[str, Any], plant: PlantSettings) -> dict[str, Any]:
    """The table `vehicle` of a scenario, on that of the mapping file of its plant unless it tells a whole car."""
    if not plant.map or not Path(plant.map).is_file() or any(key in vehicle for key in WHOLE):
        return vehicle
    if plant.kind.endswith(".xml"):
        from sidestep.plant_models.mujoco.foreign.car_map import CarMap

        return CarMap.from_file(plant.map).vehicle | vehicle
    return vehicle_table(Path(plant.map)) | vehicle


def own_car(told: dict[str, Any], plant: PlantSettings, speed: float) -> VehicleParameters | None:
    """The car of a MuJoCo model, whose tyres and steering are driven out at a speed [m/s]; None for other plants.

    Args:
        told: See `told_car`; where it tells a whole car, nothing is driven.
        plant: The plant of the scenario.
        speed: To be held, in [m/s].

    Raises:
        InputError: The model cannot be used.
        PlantError: The car in it cannot be driven.
    """
    if not plant.kind.endswith(".xml") or any(key in told for key in WHOLE):
        return None
    return _driven_out(_stamp(plant.kind), _stamp(plant.map), speed)


def _stamp(name: str) -> _Stamp:
    file = Path(name)
    return name, file.stat().st_mtime_ns if name and file.is_file() else 0


@lru_cache(maxsize=64)
def _driven_out(model: _Stamp, mapping: _Stamp, speed: float) -> VehicleParameters:
    from sidestep.plant_models.mujoco.foreign.car_map import CarMap
    from sidestep.plant_models.mujoco.foreign.plant import MjcfPlant
    from sidestep.plant_models.mujoco.foreign.vehicle import vehicle_of

    told = CarMap.from_file(mapping[0]) if mapping[0] else None
    return vehicle_of(MjcfPlant(model[0], told), speed)
