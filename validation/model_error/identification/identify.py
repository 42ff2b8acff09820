"""`sidestep identify`: k_f, k_r and I_z of a plant, and the vehicle file that the controller then uses."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.console import progress_bar
from sidestep.validation.files import check_file, write_text, written_file
from sidestep.validation.loop.measurement import measured
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.manoeuvres.open_loop import drive
from sidestep.validation.manoeuvres.scene import open_loop_scenario
from sidestep.validation.model_error.identification.identification import (
    DRIVES,
    PARAMETERS,
    SIGNALS,
    UNITS,
    Identification,
    identify,
)
from sidestep.validation.model_error.identification.vehicle_file import vehicle_toml
from sidestep.validation.studies.limits import new_table, show

COMMANDS = 5
"""Of the steering per sample, so that it is smooth between samples."""


def identify_plant(overrides: Sequence[str], out: Path, command_line: str) -> int:
    """Drive a plant, fit, print, write the vehicle file.

    Args:
        overrides: `key=value` of plant and vehicle, as given to `--set`; mass and geometry are taken as they are.
        out: Vehicle file to write.
        command_line: For its head.

    Returns:
        Exit status: 0, or 1 if the data cannot identify the car; nothing is written then.

    Raises:
        InputError, PlantError: The plant cannot be used, or the file not be written.
    """
    scenario, responses = open_loop_scenario(overrides, noisy=True), []
    with written_file(out, "--out"):
        out.parent.mkdir(parents=True, exist_ok=True)
    check_file(out, "--out")
    with open_plant(scenario) as plant, progress_bar(f"driving {scenario.plant.name}", len(DRIVES)) as progress:
        for done, manoeuvre in enumerate(DRIVES):
            progress(done)
            response = drive(plant, manoeuvre, scenario.vehicle, commands=COMMANDS)
            responses.append(measured(response, scenario.plant.noise, (scenario.plant.noise_seed, done)))
    found = identify(responses, scenario.vehicle)
    _print(found, scenario.vehicle)
    if found.problem:
        show(f"not identified: {found.problem}; nothing is written")
        return 1
    vehicle = replace(found.vehicle(scenario.vehicle), name=out.stem)
    with written_file(out, "--out"):
        write_text(out, vehicle_toml(vehicle, f"Identified by: {command_line}\n{_summary(found)}"))
    show(f"vehicle file: {out}; use it by --set vehicle.file={out}")
    return 0


def _print(found: Identification, before: VehicleParameters) -> None:
    table = new_table("Identified", "", "value", "± 95 %", "before", "unit", *(f"corr. {name}" for name in PARAMETERS))
    given = (before.cornering_stiffness_front / 2.0, before.cornering_stiffness_rear / 2.0, before.yaw_inertia)
    for i, name in enumerate(PARAMETERS):
        table.add_row(
            name, f"{found.values[i]:.5g}", f"{196.0 * found.deviations[i]:.2g} %", f"{given[i]:.5g}", UNITS[i],
            *(f"{c:.3f}" for c in found.correlation[i]),
        )  # fmt: skip
    show(table, _summary(found))


def _summary(found: Identification) -> str:
    explained = ", ".join(f"{name} {100.0 * share:.2f} %" for name, share in zip(SIGNALS, found.explained, strict=True))
    white = ", ".join(f"{q:.0f}" for q in found.ljung_box)
    verdict = "white" if found.is_white else "not white: the model lacks something, intervals are too narrow"
    return f"explained: {explained}; Ljung-Box {white}, at most {found.whiteness_bound:.0f} if white ({verdict})"
