"""The world the controller acts on: signals, vehicle data, road, obstacles, tyre law, plants."""

from typing import TYPE_CHECKING

from sidestep.plant_models.lazy import lazy

if TYPE_CHECKING:
    from sidestep.plant_models.checks.check_plant import check_plant
    from sidestep.plant_models.errors import InputError, PlantError, SidestepError
    from sidestep.plant_models.linear.plant import LinearPlant
    from sidestep.plant_models.mujoco.plant import MujocoPlant
    from sidestep.plant_models.obstacle import Obstacle
    from sidestep.plant_models.plant import Plant
    from sidestep.plant_models.road.reference_path import Arc, Clothoid, Line, ReferencePath
    from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
    from sidestep.plant_models.tyres.parameters import TyreParameters
    from sidestep.plant_models.vehicle.parameters import VehicleParameters, vehicle_presets
    from sidestep.plant_models.vehicle.suspension import SuspensionParameters

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

# Errors and single modules load without the kernels' compiler, which takes half a second; MuJoCo only if asked for.
__getattr__ = lazy(
    __name__,
    {
        "checks.check_plant": ("check_plant",),
        "errors": ("InputError", "PlantError", "SidestepError"),
        "linear.plant": ("LinearPlant",),
        "mujoco.plant": ("MujocoPlant",),
        "obstacle": ("Obstacle",),
        "plant": ("Plant",),
        "road.reference_path": ("Arc", "Clothoid", "Line", "ReferencePath"),
        "signals": ("Status", "SteeringCommand", "VehicleState"),
        "tyres.parameters": ("TyreParameters",),
        "vehicle.parameters": ("VehicleParameters", "vehicle_presets"),
        "vehicle.suspension": ("SuspensionParameters",),
    },
)
