"""The world the controller acts on: signals, vehicle data, road, obstacles, tyre law, plants."""

from typing import TYPE_CHECKING, Any

from sidestep.plant_models.check_plant import check_plant
from sidestep.plant_models.errors import InputError, PlantError, SidestepError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc, Clothoid, Line
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.vehicle.parameters import SuspensionParameters, VehicleParameters, vehicle_presets

if TYPE_CHECKING:
    from sidestep.plant_models.mujoco.plant import MujocoPlant

__all__ = [
    "Arc",
    "Clothoid",
    "InputError",
    "Line",
    "LinearPlant",
    "MujocoPlant",
    "Obstacle",
    "Plant",
    "PlantError",
    "ReferencePath",
    "SidestepError",
    "Status",
    "SteeringCommand",
    "SuspensionParameters",
    "TyreParameters",
    "VehicleParameters",
    "VehicleState",
    "check_plant",
    "vehicle_presets",
]


def __getattr__(name: str) -> Any:
    # MuJoCo is loaded only by those who ask for it: the controller runs without.
    if name == "MujocoPlant":
        from sidestep.plant_models.mujoco.plant import MujocoPlant

        return MujocoPlant
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
