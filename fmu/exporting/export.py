"""The controller of a scenario as an FMU that any importer loads: a C shim and a Python process behind it."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from sidestep.controller import ControllerConfig
from sidestep.fmu.description.plants import find_model, model_values
from sidestep.fmu.exporting.controller_variables import NAMES, controller_model
from sidestep.fmu.native.build import build_model
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

_SERVER = Path(__file__).parent / "resources" / "server.py"


def export_controller(
    name: str,
    vehicle: VehicleParameters,
    path: ReferencePath,
    obstacles: Sequence[Obstacle],
    config: ControllerConfig,
    start: VehicleState,
    fmi: int = 3,
) -> Path:
    """Build the FMU; vehicle, road and obstacles are files in it, the settings its parameters.

    Args:
        name: Of the scenario.
        vehicle, path, obstacles, config: As `SteeringController` takes them.
        start: Start values of the inputs.
        fmi: 2 or 3.

    Returns:
        Path of the .fmu file in the cache. The interpreter that runs this is the one it starts, unless the
        environment variable SIDESTEP_PYTHON names another one.

    Raises:
        InputError: Unknown FMI version, or the cache cannot be written.
        CompilerError: There is no C compiler, or it failed.
    """
    if config.cruise_speed is None:
        config = replace(config, cruise_speed=start.v_x)
    model = controller_model(name, asdict(start), config)
    description = {
        "variables": NAMES,
        "vehicle": asdict(vehicle),
        "road": {
            "table": path.table.tolist(),
            "closed": path.closed,
            "widths": path.edges.table.tolist(),
            "spacing": path.edges.spacing,
        },
        "obstacles": [obstacle.to_plain() for obstacle in obstacles],
        "controller": asdict(config),
    }
    resources = {
        "controller.json": json.dumps(description, indent=1).encode(),
        "server.py": _SERVER.read_bytes(),
        "python.txt": f"{sys.executable}\n".encode(),
    }
    return build_model(model, fmi, resources)


def start_plant(
    kind: str, vehicle: VehicleParameters, start: VehicleState, friction: float = 1.0, fmi: int = 3
) -> Path:
    """A native plant whose start values are those of a drive, for masters that set none.

    Args:
        kind: One of `plants.MODELS`.
        vehicle, start, friction: What stands in its parameters.
        fmi: 2 or 3.

    Raises:
        InputError: Unknown model or FMI version, a car without what the model needs, or no cache to write to.
        CompilerError: There is no C compiler, or it failed.
    """
    model = find_model(kind)
    values = model_values(model, vehicle, friction) | {f"{name}_0": value for name, value in asdict(start).items()}
    values |= {"steer_angle_command": start.steer_angle, "target_speed": start.v_x}
    return build_model(model.with_start(values), fmi)
