"""`sidestep identify`: a plant's cornering stiffnesses and yaw inertia, and the vehicle file for the controller."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.plant_models.vehicle.table import assumed
from sidestep.validation.console import new_table, progress_bar, show
from sidestep.validation.files import check_file, write_text, written_file
from sidestep.validation.loop.foreign import is_foreign
from sidestep.validation.loop.measurement import measured
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.manoeuvres.catalogue import Manoeuvre
from sidestep.validation.manoeuvres.open_loop import Response, drive
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
from sidestep.validation.scenarios.own_car import told_car
from sidestep.validation.scenarios.scenario import Scenario

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
            response = _driven(plant, manoeuvre, scenario)
            responses.append(measured(response, scenario.plant.noise, (scenario.plant.noise_seed, done)))
    found, taken = identify(responses, scenario.vehicle), taken_for_granted(scenario)
    _print(found, scenario.vehicle)
    show(taken)
    if found.problem:
        show(f"not identified: {found.problem}; nothing is written")
        return 1
    vehicle = replace(found.vehicle(scenario.vehicle), name=out.stem)
    with written_file(out, "--out"):
        write_text(out, vehicle_toml(vehicle, f"Identified by: {command_line}\n{_summary(found)}\n{taken}"))
    show(f"vehicle file: {out}; use it by --set vehicle.file={out}")
    return 0


def _driven(plant: Plant, manoeuvre: Manoeuvre, scenario: Scenario) -> Response:
    try:
        return drive(plant, manoeuvre, scenario.vehicle, commands=COMMANDS)
    except InputError:  # a foreign plant that makes steps of a sample's length, and none shorter
        if not is_foreign(scenario.plant):
            raise
        return drive(plant, manoeuvre, scenario.vehicle)


def taken_for_granted(scenario: Scenario) -> str:
    """What was not identified, and where it is from: motion alone tells ratios to the mass."""
    car = assumed(told_car(scenario.tables.get("vehicle", {}), scenario.plant), scenario.vehicle)
    return f"taken for granted, not identified: {car}; stiffnesses and inertia are in proportion to that mass"


def _print(found: Identification, before: VehicleParameters) -> None:
    table = new_table(
        "Identified", "", "value", "± 95 %", "before", "unit", *(f"corr. {i + 1}" for i in range(len(PARAMETERS)))
    )
    for i, name in enumerate(PARAMETERS):
        given = getattr(before, name)
        table.add_row(
            name, f"{found.values[i]:.5g}", f"{196.0 * found.deviations[i]:.2g} %", f"{given:.5g}", UNITS[i],
            *(f"{c:.3f}" for c in found.correlation[i]),
        )  # fmt: skip
    show(table, _summary(found))


def _summary(found: Identification) -> str:
    explained = ", ".join(f"{name} {100.0 * share:.2f} %" for name, share in zip(SIGNALS, found.explained, strict=True))
    white = ", ".join(f"{q:.0f}" for q in found.ljung_box)
    verdict = "white" if found.is_white else "not white: the model lacks something, intervals are too narrow"
    return f"explained: {explained}; Ljung-Box {white}, at most {found.whiteness_bound:.0f} if white ({verdict})"
