"""`sidestep validate`: where the models stop predicting a plant, a verdict, and the evidence for it."""

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.plant import Plant
from sidestep.validation.console import new_table, show
from sidestep.validation.files import made, write_text, written_to
from sidestep.validation.judge.summary import strict_json
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.manoeuvres.catalogue import MANOEUVRES, Manoeuvre
from sidestep.validation.manoeuvres.handling import bode, figures_of, overlay
from sidestep.validation.manoeuvres.metrics import asymmetry
from sidestep.validation.manoeuvres.open_loop import Response, drive
from sidestep.validation.manoeuvres.scene import open_loop_scenario
from sidestep.validation.model_error import accuracy
from sidestep.validation.model_error.envelope import (
    DURATION,
    ROADS,
    SHARES,
    SPEEDS,
    Envelope,
    envelope,
)  # fmt: skip
from sidestep.validation.model_error.envelope_figure import MODEL_TITLES, envelope_chart, limits_chart
from sidestep.validation.model_error.mujoco.checks import Check
from sidestep.validation.model_error.prediction_error import HORIZON_TIME
from sidestep.validation.model_error.prediction_models import MODELS
from sidestep.validation.model_error.validate import evidence_of, junit_cases
from sidestep.validation.report.compare.rating import rate
from sidestep.validation.report.credibility import write_credibility_report
from sidestep.validation.report.evidence import Evidence, Table
from sidestep.validation.report.exports.junit import JunitCase, write_junit
from sidestep.validation.report.style import write_figure
from sidestep.validation.scenarios.scenario import Scenario

REQUIRED, SLOWEST = 3.0, 7.5
"""The controller's model must hold up to this lateral acceleration [m/s^2] from this speed [m/s] on, on a dry road."""
QUICK_SPEEDS, QUICK_SHARES = (7.5, 15.0, 25.0, 35.0), tuple(np.linspace(0.16, 0.96, 6).tolist())
"""Cells of `--quick`."""
COMPARED = (
    MANOEUVRES["step-steer"][4],
    MANOEUVRES["step-steer"][7],
    MANOEUVRES["single-sine"][0],
    MANOEUVRES["weave"][0],
)
"""Manoeuvres in which plant and linear model are laid over each other."""
FIGURES = ("slowly-increasing-steer", "constant-radius", "step-steer", "weave", "sine-with-dwell", "coast")
"""Manoeuvres whose figures are taken; of several drives the middle one."""
NOT_COVERED = (
    "Braking, accelerating and standing: speeds are held.",
    "Banked, sloped, bumpy and split-friction roads.",
    "Delay and lag of the steering: the models get the angle that was realised.",
    "Errors in what the car measures, and in the friction that the affine model assumes.",
    "The standards' tolerances: manoeuvres and figures are in their style, no conformance is claimed.",
)


def validate_plant(
    overrides: Sequence[str], out: Path, command_line: str, jobs: int = -1, quick: bool = False,
    checks: Sequence[Check] = (), junit: Path | None = None,
) -> int:  # fmt: skip
    """Measure the envelope and all that stands behind it; write report, figures and validity.json.

    Args:
        overrides: `key=value` of plant, vehicle and controller.buffer, as given to `--set`.
        out: Folder for the files.
        command_line: For the report.
        jobs: Processes, -1 for one per core.
        quick: Fewer cells.
        checks: The plant's own, which are further evidence.
        junit: File for the verdicts as test cases, if any.

    Returns:
        Exit status: 0 if the controller's model holds where it must and all evidence passes.

    Raises:
        InputError, PlantError: The plant cannot be used, or the folder not be written.
    """
    scenario = open_loop_scenario(overrides)
    with made(out):
        found = envelope(overrides, jobs, *((QUICK_SPEEDS, QUICK_SHARES) if quick else (SPEEDS, SHARES)))
    own = [*headline(found, scenario), *_looked_at_closely(scenario)]
    evidence = [*own, *evidence_of(checks)]
    passed = all(item.passed for item in evidence if item.passed is not None)
    sentence = verdict(found)
    if junit:
        reasons = [sentence, *(item.note for item in own[1:])]
        judged = [(item, why) for item, why in zip(own, reasons, strict=True) if item.passed is not None]
        group = f"sidestep.validate.{found.plant}"
        cases = [JunitCase(group, item.title, "" if item.passed else why) for item, why in judged]
        write_junit(junit, "sidestep validate", [*cases, *junit_cases(checks)])
    with written_to(out):
        write_text(out / "validity.json", strict_json({"command_line": command_line} | found.as_tables()))
        for name, item in zip(("envelope-straight", "envelope-curved", "limits"), evidence, strict=False):
            if item.figure:
                write_figure(out / f"{name}.png", item.figure)
    context = {"Command": command_line, "Cells": f"{found.cells} a road, 3 manoeuvres of {DURATION:g} s in each",
               "Version": f"sidestep {version('sidestep')}", "Vehicle": scenario.vehicle.name}  # fmt: skip
    title = f"Validity of the prediction models on {found.plant}"
    write_credibility_report(out / "report.html", title, sentence, evidence, NOT_COVERED, context)
    _print(found, evidence)
    show(sentence, f"report: {out / 'report.html'}; limits for the controller: {out / 'validity.json'}")
    return 0 if passed else 1


def smallest_limit(found: Envelope) -> float:
    """Of the controller's model on a dry road from SLOWEST on, both roads, in [m/s^2]."""
    return float(found.largest()[:, MODELS.index("affine"), 0, found.speeds >= SLOWEST].min())


def verdict(found: Envelope) -> str:
    """One sentence."""
    limit = smallest_limit(found)
    return (
        f"{'PASS' if limit >= REQUIRED else 'FAIL'}: from {SLOWEST:g} m/s on and on a dry road, the controller's model "
        f"predicts {found.plant} to within {found.buffer:g} m for {HORIZON_TIME:g} s up to {limit:.1f} m/s² "
        f"({REQUIRED:g} m/s² required)."
    )


def headline(found: Envelope, scenario: Scenario) -> list[Evidence]:
    """The charts, and the table of limits."""
    note = (
        f"Each point: three manoeuvres (step, sine, sine with dwell) that ask for this lateral acceleration at this "
        f"speed. The model starts from the plant's state every 0.1 s and runs {HORIZON_TIME:g} s ahead with the "
        f"plant's own steering. Blue: its error stays within the corridor's buffer of {found.buffer:g} m."
    )
    passed = smallest_limit(found) >= REQUIRED
    straight, curved = (envelope_chart(found, scenario.vehicle, road) for road in ROADS)
    bend = "Half of the lateral acceleration is the road's own, the other half the manoeuvre's."
    return [
        Evidence("Validity envelope, straight road", note, straight, None, passed, "Validity"),
        Evidence("Validity envelope, curved road", bend, curved),
        Evidence(
            "Largest lateral acceleration within the buffer", "In m/s².", limits_chart(found), limits_table(found)
        ),
    ]


def limits_table(found: Envelope) -> Table:
    """Rows of model, road and friction; columns of speed."""
    limits, rows = found.largest(), []
    for m, model in enumerate(MODELS):
        for r, road in enumerate(ROADS):
            for f, friction in enumerate(found.frictions):
                numbers = (f"{value:.1f}" for value in limits[r, m, f])
                rows.append((MODEL_TITLES[model], road, f"{friction:g}", *numbers))
    return Table(("model", "road", "friction", *(f"{speed:g} m/s" for speed in found.speeds)), tuple(rows))


def _looked_at_closely(scenario: Scenario) -> list[Evidence]:
    vehicle = scenario.vehicle
    with open_plant(scenario) as plant, LinearPlant(vehicle) as linear:
        pairs = [(m, drive(plant, m, vehicle), drive(linear, m, vehicle)) for m in COMPARED]
        sweep = MANOEUVRES["sine-sweep"][1]
        answers = drive(plant, sweep, vehicle), drive(linear, sweep, vehicle)
        return [
            accuracy.error_fan(plant, vehicle),
            accuracy.kind_of_error([(m.label, own, reference) for m, own, reference in pairs]),
            _rated(pairs, scenario.plant.name),
            accuracy.step_size(plant, scenario.plant.kind, vehicle),
            _handling(plant, scenario),
            Evidence("Frequency response", f"{sweep.label}, 0.1 to 4 Hz.", bode(*answers, scenario.plant.name)),
        ]


def _rated(pairs: Sequence[tuple[Manoeuvre, Response, Response]], plant: str) -> Evidence:
    rows = []
    for manoeuvre, own, reference in pairs:
        r = rate(reference["yaw_rate"], own["yaw_rate"])
        parts = (f"{score:.3f}" for score in (r.corridor, r.phase, r.magnitude, r.slope, r.overall))
        rows.append((manoeuvre.label, *parts, r.grade))
    columns = ("manoeuvre", "corridor", "phase", "magnitude", "slope", "overall", "grade")
    manoeuvre, own, reference = pairs[1]
    figure = overlay(manoeuvre.label, own, reference, plant)
    note = "Yaw rate of the plant rated against the linear model's after ISO/TS 18571."
    return Evidence("Plant and linear model", note, figure, Table(columns, tuple(rows)))


def _handling(plant: Plant, scenario: Scenario) -> Evidence:
    rows = []
    for name in FIGURES:
        drives = MANOEUVRES[name]
        manoeuvre = drives[len(drives) // 2]
        response = drive(plant, manoeuvre, scenario.vehicle)
        found = figures_of(manoeuvre, response, scenario.vehicle)
        rows += [(manoeuvre.label, figure, value) for figure, value in found.items()]
        if name == "step-steer":
            mirrored = drive(plant, manoeuvre.mirrored(), scenario.vehicle)
            rows.append((manoeuvre.label, "left against right", f"{100.0 * asymmetry(response, mirrored):.2g} %"))
    note = "Figures after ISO 4138, 7401, 13674-1 and FMVSS 126."
    return Evidence("Handling", note, table=Table(("manoeuvre", "figure", "value"), tuple(rows)), section="Handling")


def _print(found: Envelope, evidence: Sequence[Evidence]) -> None:
    own = limits_table(found)
    table = new_table(f"Valid up to [m/s²], {found.plant}", *own.columns)
    for row in own.rows:
        table.add_row(*row)
    show(table)
    for item in evidence:
        if item.passed is not None:
            show(f"{item.verdict}  {item.title}")
