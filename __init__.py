"""sidestep: obstacle avoidance by corridor planning and model predictive control, as one stepping controller.

The names below load what they need when they are first used; `sidestep.__version__` is the installed version.
"""

from typing import TYPE_CHECKING, Any

from sidestep.plant_models.lazy import lazy

if TYPE_CHECKING:
    from sidestep.controller.config import ControllerConfig
    from sidestep.controller.steering import SteeringController
    from sidestep.plant_models.checks.check_plant import check_plant
    from sidestep.plant_models.errors import InputError, PlantError
    from sidestep.plant_models.obstacle import Obstacle
    from sidestep.plant_models.road.reference_path import Arc, Clothoid, Line, ReferencePath
    from sidestep.plant_models.signals import SteeringCommand, VehicleState
    from sidestep.plant_models.vehicle.parameters import VehicleParameters
    from sidestep.validation.scenarios.scenario import Scenario, load_scenario
    from sidestep.validation.studies.runs import drive

    __version__: str

__all__ = [
    "Arc",
    "Clothoid",
    "ControllerConfig",
    "InputError",
    "Line",
    "Obstacle",
    "PlantError",
    "ReferencePath",
    "Scenario",
    "SteeringCommand",
    "SteeringController",
    "VehicleParameters",
    "VehicleState",
    "__version__",
    "check_plant",
    "drive",
    "load_scenario",
]

_load = lazy(
    __name__,
    {
        "controller.config": ("ControllerConfig",),
        "controller.steering": ("SteeringController",),
        "plant_models": (
            "Arc", "Clothoid", "InputError", "Line", "Obstacle", "PlantError", "ReferencePath", "SteeringCommand",
            "VehicleParameters", "VehicleState", "check_plant",
        ),
        "validation.scenarios.scenario": ("Scenario", "load_scenario"),
        "validation.studies.runs": ("drive",),
    },
)  # fmt: skip


def __getattr__(name: str) -> Any:
    if name != "__version__":
        return _load(name)
    from importlib.metadata import version

    return version("sidestep")
