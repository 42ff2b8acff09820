"""The controller as files for a C program: header, libraries, an example, and the setup of a scenario."""

from collections.abc import Sequence
from pathlib import Path

from sidestep.controller import ControllerConfig
from sidestep.fmu.compiling.platforms import HOST, Platform
from sidestep.fmu.component.build import shared_library, static_library
from sidestep.fmu.component.layout import SOURCES, header
from sidestep.fmu.component.records import setup_of
from sidestep.fmu.native.build import write_to
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.vehicle.parameters import VehicleParameters


def export_library(
    out: Path, vehicle: VehicleParameters, path: ReferencePath, config: ControllerConfig,
    platforms: Sequence[Platform] = (HOST,),
) -> list[Path]:  # fmt: skip
    """Write all that somebody needs who links the controller into a program.

    Args:
        out: Folder, made if need be; libraries for several platforms are in folders of their own.
        vehicle, path, config: As `SteeringController` takes them.
        platforms: What to compile for.

    Returns:
        The files.

    Raises:
        InputError: The settings cannot be compiled, or `out` or the cache cannot be written.
        PlantError: There is no C compiler for a platform, or the step does not compile.
    """
    files = {
        "controller.setup": setup_of(vehicle, path, config),
        "sidestep.h": header().encode(),
        "example.c": (SOURCES / "example.c").read_bytes(),
    }
    for platform in platforms:
        place = "" if len(platforms) == 1 else f"{platform.fmi3}/"
        files[f"{place}libsidestep{platform.suffix}"] = shared_library(platform)
        files[f"{place}libsidestep.a"] = static_library(platform)
    written = []
    for name, data in files.items():
        file = out / name
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(str(file.parent), f"cannot be made: {error.strerror}") from error
        written.append(write_to(file, data))
    return written
