"""The controller of a scenario as an FMU that needs nothing but its host, and plants that start where it does."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from sidestep.controller import ControllerConfig
from sidestep.controller.settings import settings_of
from sidestep.fmu.compiling.platforms import HOST, Platform
from sidestep.fmu.component.build import component_files, revision
from sidestep.fmu.component.records import setup_of
from sidestep.fmu.description.plants import find_model, model_values
from sidestep.fmu.exporting.controller_variables import controller_model
from sidestep.fmu.native.build import build_model
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters


def export_controller(
    name: str,
    vehicle: VehicleParameters,
    path: ReferencePath,
    obstacles: Sequence[Obstacle],
    config: ControllerConfig,
    start: VehicleState,
    fmi: int = 3,
    platforms: Sequence[Platform] = (HOST,),
) -> Path:
    """Build the FMU; car and road are a file in it, the settings its parameters, state and obstacles its inputs.

    Args:
        name: Of the scenario.
        vehicle, path, config: As `SteeringController` takes them; the solver is the active set in any case.
        obstacles: Start values of those inputs.
        start: Start values of the car's state.
        fmi: 2 or 3.
        platforms: What to compile for, this machine among it.

    Returns:
        Path of the .fmu file in the cache.

    Raises:
        InputError: Unknown FMI version, settings whose solver is not compiled, or the cache cannot be written.
        PlantError: There is no C compiler, it failed, or the step does not compile.
    """
    if config.cruise_speed is None:
        config = replace(config, cruise_speed=start.v_x)
    setup = setup_of(vehicle, path, config)
    grid = settings_of(vehicle, config)["grid"][0]
    times = grid["times"][: grid["nodes"]].tolist()
    model = controller_model(name, asdict(start), config, obstacles, times, revision())
    return build_model(model, fmi, {"controller.setup": setup}, platforms, component_files)


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
