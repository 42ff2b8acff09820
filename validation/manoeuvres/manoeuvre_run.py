"""`sidestep validate --manoeuvre`: one manoeuvre on one plant."""

from collections.abc import Sequence
from pathlib import Path

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.console import coloured, new_table, show
from sidestep.validation.files import made, written_to
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import write_columns
from sidestep.validation.manoeuvres.catalogue import MANOEUVRES, Manoeuvre
from sidestep.validation.manoeuvres.driven import DRIVEN, driven_manoeuvre
from sidestep.validation.manoeuvres.handling import figures_of, overlay, ratings
from sidestep.validation.manoeuvres.open_loop import RESPONSE_UNITS, Response, drive
from sidestep.validation.manoeuvres.scene import open_loop_scenario
from sidestep.validation.report.exports.junit import judged_case, write_junit
from sidestep.validation.report.style import write_figure
from sidestep.validation.scenarios.library import built_in_scenarios


def list_manoeuvres() -> int:
    """Print the names."""
    table = new_table("Manoeuvres", "open loop", "drives")
    for name, drives in MANOEUVRES.items():
        table.add_row(name, "; ".join(m.label.removeprefix(f"{name}, ") for m in drives))
    show(table, f"driven by the controller: {', '.join((*DRIVEN, *built_in_scenarios()))}, or a scenario's TOML file")
    return 0


def run_manoeuvre(name: str, overrides: Sequence[str], out: Path, junit: Path | None = None) -> int:
    """Run every drive of a manoeuvre; print its figures; of open-loop ones, which have no verdict, write signals.

    Args:
        name: One that `list_manoeuvres` prints.
        overrides: `key=value`, as given to `--set`.
        out: Folder for signals and pictures.
        junit: File for the verdicts as test cases, if any.

    Returns:
        Exit status: 0, or 1 if the controller drove it and failed.

    Raises:
        InputError: No such manoeuvre, a bad override, or a folder that cannot be written.
        PlantError: The plant cannot start or go on.
    """
    if name in MANOEUVRES:
        _open_loop(name, overrides, out)
        return 0
    table, results = new_table(name, "drive", "verdict", "outcome"), driven_manoeuvre(name, overrides)
    for result in results:
        table.add_row(result.name, coloured(result.verdict.value, result.verdict.value.upper()), result.text)
    show(table)
    if junit:
        cases = [judged_case(f"sidestep.validate.{name}", r.name, r.verdict, r.text) for r in results]
        write_junit(junit, "sidestep validate", cases)
    return 0 if all(result.verdict is Verdict.PASS for result in results) else 1


def _open_loop(name: str, overrides: Sequence[str], out: Path) -> None:
    """Of each drive a table, a CSV and a picture beside the linear model's."""
    scenario = open_loop_scenario(overrides)
    vehicle = scenario.vehicle
    with made(out), open_plant(scenario) as plant, LinearPlant(vehicle) as linear:
        for number, manoeuvre in enumerate(MANOEUVRES[name], 1):
            response, reference = drive(plant, manoeuvre, vehicle), drive(linear, manoeuvre, vehicle)
            table = new_table(manoeuvre.label, "figure", scenario.plant.name, "linear model")
            ours, theirs = (_figures(manoeuvre, d, vehicle) for d in (response, reference))
            for figure in ours:
                table.add_row(figure, ours[figure], theirs.get(figure, ""))
            for figure, value in ratings(reference, response).items():
                table.add_row(figure, value, "")
            show(table)
            figure = overlay(manoeuvre.label, response, reference, scenario.plant.name)
            with written_to(out):
                write_columns(out / f"{name}-{number}.csv", response, RESPONSE_UNITS)
                write_figure(out / f"{name}-{number}.png", figure)
    show(f"signals and pictures: {out}")


def _figures(manoeuvre: Manoeuvre, response: Response, vehicle: VehicleParameters) -> dict[str, str]:
    try:
        return figures_of(manoeuvre, response, vehicle)
    except InputError as error:
        return {"figures": error.problem}
