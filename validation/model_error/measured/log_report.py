"""The report on a log: what is in it, the car that it tells, measured against each model, envelope, replay."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sidestep.plant_models.vehicle.parameters import GRAVITY
from sidestep.validation.model_error.identification.car_kernel import Chassis, Values, simulate
from sidestep.validation.model_error.identification.log_identification import LogIdentification
from sidestep.validation.model_error.identification.window_fit import CHANNELS, delayed
from sidestep.validation.model_error.logs.measured import HIGHEST, PERIOD, MeasuredLog
from sidestep.validation.model_error.measured.log_envelope import LogEnvelope, envelope_figure
from sidestep.validation.model_error.measured.replay import Replay, replay_figure, summary
from sidestep.validation.model_error.measured.scores import (
    MANOEUVRES,
    RANGES,
    Scores,
    Starts,
    by_range,
    p95,
)
from sidestep.validation.model_error.prediction_error import HORIZON_TIME
from sidestep.validation.model_error.prediction_models import MODELS
from sidestep.validation.report.evidence import Evidence, Table
from sidestep.validation.report.style import BLUE, FAINT, GREEN, INK, ORANGE, legend, panel, styled

Array = NDArray[np.float64]

NOT_COVERED = (
    "What the log does not hold: other roads, tyres, loads, speeds and lateral accelerations.",
    "The mass and the axles' distances, which are told: stiffness, inertia and peaks scale with the mass.",
    "Bank and grade of the road are unknowns, not measurements: a bank that always goes with the turn looks like roll.",
    "The standards' tolerances: figures are in ISO 19364's style (the model sets bounds, measured points lie inside or "
    "not), no conformance is claimed.",
)
_UNITS = {"yaw_rate": "rad/s", "a_y": "m/s²", "v_y": "m/s"}
_BOUND = 0.05  # of the model's steady steering that the graphical bounds of the steady state allow, and of its angle
_SHOWN = 4  # windows drawn


def parameter_table(found: LogIdentification) -> Table:
    """Every parameter with interval, or why it is refused."""
    rows = []
    for v in found.verdicts:
        interval = f"{v.low:.4g} to {v.high:.4g}" if np.isfinite(v.low + v.high) else ""
        value = f"{v.value:.4g}" if interval else ""
        rows.append((v.parameter.words, v.parameter.name, value, interval, v.parameter.unit, v.refused or "identified"))
    return Table(("parameter", "", "value", "95 % interval", "unit", "verdict"), tuple(rows))


def identification_evidence(found: LogIdentification) -> Evidence:
    """The table with its sentences."""
    sentences = [f"{name}: {why}." for name, why in found.left_out.items()]
    if found.problem:
        sentences.append(f"Nothing is identified: {found.problem}.")
    note = (
        " ".join(sentences) + "\n\nIntervals count what the residuals share within a window of 3 s, and each window's "
    )
    note += "own bank and start; what the car has and the model has not is not in them but for the least ones."
    return Evidence("The car and its sensors", note.strip(), table=parameter_table(found), section="Identified")


def models_table(scores: Sequence[Scores], starts: Starts) -> Table:
    """VAF and offset error by range of lateral acceleration; a row per model."""
    signals = list(scores[0].explained)
    ranges = by_range(starts)
    heads = [f"{name}" for name in signals] + [f"{name}, raw" for name in signals]
    heads += [f"{low:g} to {high:g} m/s²" if np.isfinite(high) else f"above {low:g} m/s²" for low, high in RANGES]
    rows = []
    for s in scores:
        shares = [s.explained[name] for name in signals] + [s.explained_raw[name] for name in signals]
        cells = [f"{share:.4f}" for share in shares] + [_metres(p95(s.offset, chosen)) for chosen in ranges]
        rows.append((s.model, *cells))
    rows.append(("starting points", *[""] * (2 * len(signals)), *(f"{chosen.sum()}" for chosen in ranges)))
    return Table(("model", *heads), tuple(rows))


def manoeuvre_table(scores: Sequence[Scores], starts: Starts) -> Table:
    """Offset error by manoeuvre."""
    kinds = [starts.manoeuvre == i for i in range(len(MANOEUVRES))]
    rows = [(s.model, *(_metres(p95(s.offset, chosen)) for chosen in kinds)) for s in scores]
    rows.append(("starting points", *(f"{chosen.sum()}" for chosen in kinds)))
    return Table(("model", *MANOEUVRES), tuple(rows))


def _metres(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.2f}"


def model_evidence(scores: Sequence[Scores], starts: Starts, fitted: str, passed: bool) -> list[Evidence]:
    """Measured against each model."""
    note = (
        f"Fitted to {fitted}. Windows of 3 s from measured starts, steering and speed as measured. Share of the "
        f"variance that the model explains, below {HIGHEST:g} Hz and, as raw, with all that the sensors add. Then the "
        f"95th percentile of the lateral offset's error {HORIZON_TIME:g} s ahead [m], by the mean lateral acceleration."
    )
    return [
        Evidence("Measured against each model", note, offset_figure(scores, starts), models_table(scores, starts),
                 passed, "Models"),
        Evidence("By manoeuvre", "The same error, in m.", table=manoeuvre_table(scores, starts)),
    ]  # fmt: skip


def offset_figure(scores: Sequence[Scores], starts: Starts) -> Figure:
    """p95 of the offset error over lateral acceleration."""
    edges = np.arange(0.0, max(starts.lateral.max(initial=1.0), 1.0) + 1.0)
    with styled():
        figure = Figure(figsize=(9.0, 3.4), layout="constrained")
        axes = panel(figure.subplots(), f"lateral offset {HORIZON_TIME:g} s ahead, p95 of the error", "m")
        for s, colour in zip(scores, (ORANGE, BLUE, GREEN, INK), strict=True):
            values = [p95(s.offset, (starts.lateral >= a) & (starts.lateral < b)) for a, b in pairwise(edges)]
            axes.plot(edges[:-1] + 0.5, values, ".-", color=colour, label=s.model)
        axes.set(xlabel="mean lateral acceleration [m/s²]", ylim=(0.0, None))
        axes.legend(loc="upper left")
    return figure


def steady_evidence(log: MeasuredLog, values: Values, chassis: Chassis) -> Evidence:
    """Steering over lateral acceleration in steady turns, measured points and the bounds that the model sets."""
    lateral = log.smooth("yaw_rate") - values.yaw_rate_offset
    lateral = lateral * log.signals["v_x"]
    place = np.arange(len(log.time))
    steer = np.interp(place - values.steer_delay / PERIOD, place, log.signals["steer"])
    angle = values.steer_gain * steer + values.steer_offset
    calm = log.usable & (np.abs(np.gradient(lateral, PERIOD)) < 2.0) & (np.abs(log.signals["a_x"]) < 1.5)
    length = chassis.l_f + chassis.l_r
    extra = (angle - length * lateral / log.signals["v_x"] ** 2)[calm][::10]  # beyond what the turn's geometry asks for
    points = lateral[calm][::10]
    side = np.sign(points)
    grid = np.linspace(0.2, max(float(np.percentile(np.abs(points), 99.5)) if len(points) else 1.0, 1.0), 40)
    model = np.array([_steady_extra(values, chassis, a) for a in grid])
    allowed = np.radians(0.3) + _BOUND * np.abs(model)
    at = np.interp(np.abs(points), grid, model)
    share = (
        float(np.mean(np.abs(side * extra - at) <= np.interp(np.abs(points), grid, allowed))) if len(points) else 0.0
    )
    with styled():
        figure = Figure(figsize=(9.0, 3.4), layout="constrained")
        axes = panel(figure.subplots(), "road-wheel angle beyond the turn's geometry", "deg")
        axes.plot(np.abs(points), np.degrees(side * extra), ".", color=FAINT, ms=3, label="measured")
        axes.plot(grid, np.degrees(model), color=BLUE, label="model")
        for sign in (-1.0, 1.0):
            axes.plot(grid, np.degrees(model + sign * allowed), color=BLUE, lw=0.8, ls="--", label="bounds")
        axes.set_xlabel("lateral acceleration [m/s²]")
        legend(axes)
    note = (
        f"ISO 19364's style: the simulated curve sets bounds (± 0.3° and {_BOUND:.0%}, ours), and {share:.0%} of the "
        "measured points of calm turns lie within. Below zero the car oversteers."
    )
    return Evidence("Steady turns", note, figure)


def _steady_extra(v: Values, c: Chassis, lateral: float) -> float:
    """Difference of the axles' slip angles in a steady turn, in [rad]; NaN beyond the peak."""
    length = c.l_f + c.l_r
    slips = []
    for stiffness, peak, curvature, lever in ((v.C_f, v.mu_f, v.e_f, c.l_r), (v.C_r, v.mu_r, v.e_r, c.l_f)):
        load = c.mass * GRAVITY * lever / length
        force = c.mass * lateral * lever / length
        grid = np.linspace(0.0, 0.35, 700)
        x = stiffness * grid / (1.1 * peak * load)
        forces = peak * load * np.sin(1.1 * np.arctan(x - curvature * (x - np.arctan(x))))
        top = int(forces.argmax())
        slips.append(float(np.interp(force, forces[: top + 1], grid[: top + 1], right=np.nan)))
    return slips[0] - slips[1]


def windows_evidence(
    log: MeasuredLog, values: Values, linear: Values, chassis: Chassis, starts: Starts
) -> Evidence:  # fmt: skip
    """A few windows of 3 s over time: measured, Magic Formula, linear; the busiest, spread over the log."""
    order = np.array_split(np.arange(len(starts.index)), _SHOWN)
    chosen = np.array([part[int(starts.lateral[part].argmax())] for part in order if len(part)])
    steps = round(3.0 / PERIOD)
    first = np.minimum(starts.index[chosen], len(log.time) - steps - 2)
    still = np.zeros((len(first), 4))
    names = [name for name in CHANNELS if name in log.signals]
    with styled():
        figure = Figure(figsize=(11.0, 2.0 * len(names) + 0.4), layout="constrained")
        panels = figure.subplots(len(names), len(first), sharey="row", squeeze=False)
        for car, is_linear, colour, label in ((linear, True, ORANGE, "linear"), (values, False, BLUE, "Magic Formula")):
            out = delayed(simulate(car, chassis, log.signals, first, steps, still, is_linear), car)
            for j, k in enumerate(first):
                for i, name in enumerate(names):
                    if not is_linear:
                        panels[i, j].plot(log.time[k : k + steps], log.smooth(name)[k : k + steps], color=INK, lw=1.0,
                                          label="measured")  # fmt: skip
                    series = out[j, :, CHANNELS.index(name)]
                    panels[i, j].plot(log.time[k : k + steps], series, color=colour, lw=1.0, label=label)
        for i, name in enumerate(names):
            panels[i, 0].set_ylabel(f"{name} [{_UNITS[name]}]")
        panels[0, -1].legend(loc="best", fontsize=7)
    return Evidence("Four windows", "The busiest of each quarter of the log, over its time in s.", figure)


def envelope_evidence(found: LogEnvelope) -> Evidence:
    """The controller's models by speed, and the limits they give."""
    rows = [
        (model, *(f"{limit:.1f}" for limit in limits)) for model, limits in zip(MODELS, found.largest(), strict=True)
    ]
    heads = ("up to [m/s²] at", *(f"{speed:g} m/s" for speed in found.speeds))
    note = (
        f"The controller's own models with the vehicle file, as on plants: p95 of the lateral error "
        f"{HORIZON_TIME:g} s ahead, valid while it stays within the buffer of {found.buffer:g} m. The error holds what "
        "sensors and an unknown bank add: small limits may be the log's, not the model's. --set controller.buffer=... "
        "asks for another buffer."
    )
    return Evidence(
        "Validity envelope of this car", note, envelope_figure(found), Table(heads, tuple(rows)), section="Envelope"
    )


def replay_evidence(found: Replay | None) -> Evidence:
    """What our controller would have steered."""
    if found is None:
        return Evidence("Replay", "No stretch of the log is long enough.", section="Replay")
    numbers = summary(found)
    status = ", ".join(f"{name} {share:.0%}" for name, share in found.status.items())
    end = (
        f" At {found.time[-1]:.1f} s it leaves the driven line for good: the driver's speed is its limit."
        if found.lost
        else ""
    )
    note = (
        "The driven line as the road, the driver's speed, our steering, on the identified car. "
        f"Difference RMS {np.degrees(numbers['steer_difference_rms_rad']):.2f}°, "
        f"correlation {numbers['steer_correlation']:.3f}; our car stays within {numbers['offset_max_m']:.2f} m of the "
        f"driven line (RMS {numbers['offset_rms_m']:.2f} m). Steps: {status}.{end}"
    )
    return Evidence("Our controller on this road", note, replay_figure(found), section="Replay")


def log_table(log: MeasuredLog) -> Evidence:
    """What is in the log."""
    rows = [(name, f"{values.min():.4g}", f"{values.max():.4g}") for name, values in log.signals.items()
            if not name.startswith("start")]  # fmt: skip
    note = ". ".join([f"{log.time[-1]:.0f} s, {log.usable.mean():.1%} of it used", *log.notes]) + "."
    return Evidence("The log", note, table=Table(("signal", "least", "largest"), tuple(rows)), section="The log")
