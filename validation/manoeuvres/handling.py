"""What a drive shows of a plant's handling: the standards' figures of one manoeuvre, and the picture of it."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.manoeuvres.catalogue import Manoeuvre
from sidestep.validation.manoeuvres.frequency_response import LEAST_COHERENCE, frequency_response
from sidestep.validation.manoeuvres.metrics import (
    deceleration,
    dwell_response,
    gradients,
    step_response,
    tb_factor,
    weave,
)
from sidestep.validation.manoeuvres.open_loop import Response
from sidestep.validation.report.compare.rating import rate
from sidestep.validation.report.style import BLUE, INK, legend, panel, styled

SIGNALS = {
    "steer_angle": ("steering", "deg", 180.0 / math.pi),
    "yaw_rate": ("yaw rate", "deg/s", 180.0 / math.pi),
    "lateral_acceleration": ("lateral acceleration", "m/s²", 1.0),
    "v_y": ("lateral speed", "m/s", 1.0),
    "roll": ("roll", "deg", 180.0 / math.pi),
}
"""What is drawn: title, unit and factor."""


def figures_of(manoeuvre: Manoeuvre, response: Response, vehicle: VehicleParameters) -> dict[str, str]:
    """The manoeuvre's figures with their units.

    Raises:
        InputError: The drive does not show them, such as a car that slid away.
    """
    return {name: f"{value:.4g} {unit}".rstrip() for name, value, unit in _figures(manoeuvre, response, vehicle)}


def _figures(manoeuvre: Manoeuvre, response: Response, vehicle: VehicleParameters) -> Sequence[tuple[str, float, str]]:
    degrees, per_g = 180.0 / math.pi, GRAVITY * 180.0 / math.pi
    if manoeuvre.name in ("slowly-increasing-steer", "constant-radius"):
        found = gradients(response, vehicle)
        names = ("understeer gradient", "sideslip gradient", "roll gradient")
        values = (found.understeer, found.sideslip, found.roll)
        return [(n, per_g * value, "deg/g") for n, value in zip(names, values, strict=True) if not math.isnan(value)]
    if manoeuvre.name == "step-steer":
        yaw, side = step_response(response), step_response(response, "lateral_acceleration")
        return [
            ("steady yaw rate", degrees * yaw.steady, "deg/s"), ("yaw T90", yaw.response_time, "s"),
            ("yaw peak time", yaw.peak_time, "s"), ("yaw overshoot", 100.0 * yaw.overshoot, "%"),
            ("a_y T90", side.response_time, "s"), ("a_y overshoot", 100.0 * side.overshoot, "%"),
            ("TB factor", degrees * tb_factor(response), "s deg"),
        ]  # fmt: skip
    if manoeuvre.name == "weave":
        found = weave(response)
        return [
            ("sensitivity", found.sensitivity / degrees, "m/s²/deg"), ("dead band", degrees * found.dead_band, "deg"),
            ("lag", found.lag, "s"),
        ]  # fmt: skip
    if manoeuvre.name == "sine-with-dwell":
        found = dwell_response(response)
        return [
            ("yaw rate after 1.00 s", 100.0 * found.after_1_00, "% of the peak"),
            ("after 1.75 s", 100.0 * found.after_1_75, "%"), ("displacement", found.displacement, "m"),
        ]  # fmt: skip
    if manoeuvre.name in ("sine-sweep", "random-steer"):
        bode = frequency_response(response)
        at = int(np.argmin(np.abs(bode.frequency - 1.0)))
        return [
            ("gain at 1 Hz", float(bode.gain[at]), "1/s"), ("phase at 1 Hz", degrees * float(bode.phase[at]), "deg"),
            (f"coherence >= {LEAST_COHERENCE}", 100.0 * float(bode.trusted.mean()), "% of the range"),
        ]  # fmt: skip
    if manoeuvre.name == "coast":
        drift = float(np.abs(response["y"]).max())
        return [("deceleration", deceleration(response), "m/s²"), ("drift to the side", drift, "m")]
    peaks = ("yaw_rate", degrees, "deg/s"), ("lateral_acceleration", 1.0, "m/s²")
    return [(f"largest {SIGNALS[name][0]}", factor * float(np.abs(response[name]).max()), unit)
            for name, factor, unit in peaks]  # fmt: skip


def ratings(reference: Response, response: Response) -> dict[str, str]:
    """ISO/TS 18571 of the plant's signals against the linear model's; a signal that never moves is left out."""
    moving = [name for name in ("yaw_rate", "lateral_acceleration") if np.ptp(reference[name]) > 1e-9]
    found = {name: rate(reference[name], response[name]) for name in moving}
    return {f"{SIGNALS[name][0]}, 18571": f"{r.overall:.3f} {r.grade}" for name, r in found.items()}


def overlay(title: str, response: Response, reference: Response, plant: str) -> Figure:
    """Signals of the plant over those of the linear model."""
    names = [name for name in SIGNALS if name in response]
    with styled():
        figure = Figure(figsize=(9.0, 1.55 * len(names) + 0.5), layout="constrained")
        panels = figure.subplots(len(names), 1, sharex=True)
        for axes, name in zip(panels, names, strict=True):
            label, unit, factor = SIGNALS[name]
            if name in reference:
                axes.plot(reference["time"], factor * reference[name], color=INK, lw=1.0, label="linear model")
            axes.plot(response["time"], factor * response[name], color=BLUE, label=plant)
            panel(axes, label, unit)
        legend(panels[0])
        panels[-1].set_xlabel("time [s]")
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    return figure


def bode(response: Response, reference: Response, plant: str) -> Figure:
    """Gain, phase and coherence of the yaw rate over the road-wheel angle; faint where the coherence is too low."""
    with styled():
        figure = Figure(figsize=(6.5, 6.0), layout="constrained")
        gain, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
        for drive, colour, label in ((reference, INK, "linear model"), (response, BLUE, plant)):
            found = frequency_response(drive)
            for values, axes in ((found.gain, gain), (np.degrees(found.phase), phase)):
                axes.plot(found.frequency, values, color=colour, alpha=0.3)
                axes.plot(found.frequency, np.where(found.trusted, values, np.nan), color=colour, label=label)
            coherence.plot(found.frequency, found.coherence, color=colour)
        coherence.axhline(LEAST_COHERENCE, color=INK, ls=":", lw=1.0)
        coherence.set_ylim(0.5, 1.02)
        for axes, title, unit in ((gain, "yaw rate over road-wheel angle", "1/s"), (phase, "phase", "deg"),
                                  (coherence, "coherence", "-")):  # fmt: skip
            panel(axes, title, unit).set_xscale("log")
        ticks = (0.2, 0.5, 1.0, 2.0)
        coherence.set_xticks(ticks, [f"{f:g}" for f in ticks])
        coherence.set_xticks([], minor=True)
        coherence.set_xlabel("frequency [Hz]")
        legend(gain)
    return figure
