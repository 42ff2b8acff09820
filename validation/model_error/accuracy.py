"""How good the models' predictions of one plant are: error over the horizon, kind of error, step size."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from sidestep.plant_models.plant import Plant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.open_loop import Response, drive
from sidestep.validation.model_error.envelope import cell_manoeuvres
from sidestep.validation.model_error.envelope_figure import MODEL_TITLES
from sidestep.validation.model_error.prediction_error import STATE_UNITS, prediction_errors, statistics
from sidestep.validation.model_error.prediction_models import MODELS, STEP
from sidestep.validation.model_error.step_size import LARGEST_SHARE, StepSize, step_halving
from sidestep.validation.model_error.theil import theil
from sidestep.validation.report.evidence import Evidence, Table
from sidestep.validation.report.style import BLUE, panel, styled

SPEED, ACCELERATION = 15.0, 4.0
"""Cell that is looked at closely, in [m/s] and [m/s^2]."""


def error_fan(plant: Plant, vehicle: VehicleParameters) -> Evidence:
    """Error of every model over the horizon."""
    drives = [drive(plant, m, vehicle) for m in cell_manoeuvres(SPEED, ACCELERATION, 0.0)]
    found = {model: statistics([prediction_errors(model, d, vehicle) for d in drives]) for model in MODELS}
    rows, steps = [], np.arange(1, found[MODELS[0]].rms.shape[0] + 1) * STEP
    with styled():
        figure = Figure(figsize=(9.5, 2.9), layout="constrained")
        for axes, (model, s) in zip(figure.subplots(1, len(MODELS), sharey=True), found.items(), strict=True):
            for low, high, alpha in ((s.p95, s.max, 0.15), (s.p50, s.p95, 0.35)):
                axes.fill_between(steps, low[:, 0], high[:, 0], color=BLUE, alpha=alpha, lw=0.0)
            axes.plot(steps, s.p95[:, 0], color=BLUE, label="p95")
            panel(axes, MODEL_TITLES[model], "m").set_xlabel("time ahead [s]")
            rows += [
                (MODEL_TITLES[model], name, unit, *(f"{values[-1, i]:.4f}" for values in (s.rms, s.p50, s.p95, s.max)))
                for i, (name, unit) in enumerate(STATE_UNITS.items())
            ]
    note = (
        f"Lateral error at {SPEED:g} m/s and {ACCELERATION:g} m/s² over the horizon: median to p95 dark, p95 to the "
        "largest light. Below, all states at its end."
    )
    columns = ("model", "state", "unit", "RMS", "p50", "p95", "max")
    return Evidence("Prediction error over the horizon", note, figure, Table(columns, tuple(rows)), section="Accuracy")


def kind_of_error(pairs: Sequence[tuple[str, Response, Response]]) -> Evidence:
    """Theil's split of the linear model's yaw rate against the plant's.

    Args:
        pairs: Name of the manoeuvre, the plant's drive and the linear model's.
    """
    rows = []
    for name, response, reference in pairs:
        t = theil(response["yaw_rate"], reference["yaw_rate"])
        rows.append((name, f"{t.u:.3f}", *(f"{100.0 * share:.0f} %" for share in (t.bias, t.variance, t.covariance))))
    note = (
        "Theil's U of the linear model's yaw rate, 0 perfect, and the shares of its error. Bias and variance are an "
        "offset and a gain, which parameters can heal; covariance is what the model has not got."
    )
    return Evidence(
        "Kind of error", note, table=Table(("manoeuvre", "U", "bias", "variance", "covariance"), tuple(rows))
    )


def step_size(plant: Plant, kind: str, vehicle: VehicleParameters) -> Evidence:
    """Whether the plant's numerics are good enough to speak of a model's error."""
    found = step_halving(plant, kind, vehicle, SPEED, ACCELERATION)
    rows = tuple((MODEL_TITLES[s.model], f"{s.model_error:.4f}", *_share(s)) for s in found)
    note = (
        f"p95 of the lateral error at {SPEED:g} m/s and {ACCELERATION:g} m/s², and its change when the plant's step "
        f"is halved. Of the linear model's, of which the envelope speaks first, it must stay below {LARGEST_SHARE:.0%}."
    )
    if found[0].passed is None:
        note += (
            f" Not assessable: what {Path(kind).name} answers does not change with the step at which it is called, so "
            "its own step is another, which only its maker can halve."
        )
    columns = ("model", "model error [m]", "numerical error [m]", "share")
    return Evidence("Step halving", note, table=Table(columns, rows), passed=found[0].passed)


def _share(step: StepSize) -> tuple[str, str]:
    if step.passed is None:
        return "not assessable", "not assessable"
    return f"{step.numerical_error:.2e}", f"{100.0 * step.numerical_error / step.model_error:.3f} %"
