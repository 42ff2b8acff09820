"""The headline chart: where a model stops predicting a plant."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure

from sidestep.controller import ControllerConfig
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.open_loop import steady_acceleration
from sidestep.validation.model_error.envelope import ROADS, Array, Envelope
from sidestep.validation.model_error.prediction_error import HORIZON_TIME
from sidestep.validation.model_error.prediction_models import MODELS
from sidestep.validation.report.style import BLUE, FAINT, GREEN, INK, ORANGE, PAPER, panel, styled

MODEL_TITLES = {
    "linear": "linear model (5)",
    "euler": "Euler model (7)",
    "affine": "affine tyres, the controller's",
}
_BANDS = np.array([0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 1e3])  # error over buffer
_SHADES = ("#2f6f9f", "#6ba3c8", "#a9cde3", "#dcecf5", "#fde3c8", "#f8b77e", "#e57f45", "#b5462a")
_MODEL_COLOURS = {"linear": INK, "euler": ORANGE, "affine": BLUE}


def envelope_chart(envelope: Envelope, vehicle: VehicleParameters, road: str = "straight") -> Figure:
    """Error over speed and commanded lateral acceleration; a row a model, a column a friction.

    Args:
        envelope: What was measured.
        vehicle: The car of Eq. (14).
        road: One of ROADS.
    """
    errors, limits = envelope.errors[ROADS.index(road)], envelope.largest()[ROADS.index(road)]
    columns = len(envelope.frictions)
    with styled():
        figure = Figure(figsize=(2.2 + 2.9 * columns, 7.6), layout="constrained")
        panels = figure.subplots(len(MODELS), columns, sharex=True, sharey="col", squeeze=False)
        filled = [
            _cells(panels[m, f], envelope, errors[m, f], f) for m in range(len(MODELS)) for f in range(columns)
        ]  # fmt: skip
        for (m, f), axes in np.ndenumerate(panels):
            _lines(axes, envelope, limits[m, f], f, vehicle)
        for axes, model in zip(panels[:, 0], MODELS, strict=True):
            axes.set_ylabel(f"{MODEL_TITLES[model]}\n\ncommanded $a_y$ [m/s²]")
        for f, friction in enumerate(envelope.frictions):
            panels[0, f].set_title(f"friction {friction:g}", loc="center")
            panels[-1, f].set_xlabel("speed [m/s]")
        bar = figure.colorbar(
            filled[0], ax=panels, shrink=0.75, aspect=32, pad=0.015, ticks=_BANDS[:-1] * envelope.buffer
        )
        bar.ax.set_yticklabels(f"{band * envelope.buffer:.3g}" for band in _BANDS[:-1])
        bar.set_label(f"p95 of the lateral error {HORIZON_TIME:g} s ahead [m]")
        bar.ax.minorticks_off()
        bar.ax.axhline(envelope.buffer, color=INK, lw=2.5)
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        title = f"Where each model stops predicting {envelope.plant}, {road} road"
        figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
    return figure


def _cells(axes: Axes, envelope: Envelope, errors: Array, f: int) -> QuadContourSet:
    """Filled bands; from an error of 0 at rest, as `crossing` has it; hatched where the plant gave up."""
    y = np.concatenate([[0.0], envelope.accelerations[f]])
    z = np.column_stack([np.zeros(len(errors)), errors]).T
    levels = _BANDS * envelope.buffer
    axes.set_facecolor("#d9dde1")
    filled = axes.contourf(
        envelope.speeds, y, np.ma.masked_invalid(z), levels=levels, cmap=ListedColormap(_SHADES),
        norm=BoundaryNorm(levels, len(_SHADES)), extend="neither",
    )  # fmt: skip
    axes.plot(*np.meshgrid(envelope.speeds, y[1:]), ".", color=INK, ms=1.6, alpha=0.35, clip_on=False)
    axes.grid(visible=False)
    return filled


def _lines(axes: Axes, envelope: Envelope, limits: Array, f: int, vehicle: VehicleParameters) -> None:
    speeds, top = envelope.speeds, envelope.tyre_limits[f]
    axes.plot(speeds, limits, color=PAPER, lw=4.4)
    axes.plot(speeds, limits, color=INK, lw=2.6, label=f"error = buffer, {envelope.buffer:g} m")
    axes.axhline(top, color=INK, lw=1.2, ls="--", label="tyre limit")
    grid = np.linspace(speeds[0], speeds[-1], 100)
    axes.plot(
        grid, [_angle_bound(v, envelope.frictions[f], vehicle) for v in grid], color=INK, lw=1.4, ls=":",
        label="Eq. (14)",
    )  # fmt: skip
    axes.set(xlim=(speeds[0], speeds[-1]), ylim=(0.0, 1.04 * top))


def _angle_bound(speed: float, friction: float, vehicle: VehicleParameters) -> float:
    """Steady lateral acceleration at the bound (14) of the angle, its a_y,max scaled by the friction, in [m/s^2]."""
    largest = friction * ControllerConfig().max_lateral_acceleration
    return steady_acceleration(math.atan(vehicle.wheelbase * largest / speed**2), speed, vehicle)


def limits_chart(envelope: Envelope) -> Figure:
    """Largest acceleration within the buffer over speed, all models and both roads."""
    limits, columns = envelope.largest(), len(envelope.frictions)
    with styled():
        figure = Figure(figsize=(2.0 + 3.0 * columns, 3.4), layout="constrained")
        panels = figure.subplots(1, columns, sharey=True, squeeze=False)[0]
        for f, axes in enumerate(panels):
            for m, model in enumerate(MODELS):
                for road, dashes in zip(range(len(ROADS)), ("-", "--"), strict=True):
                    label = f"{MODEL_TITLES[model]}" if road == 0 else None
                    axes.plot(envelope.speeds, limits[road, m, f], dashes, color=_MODEL_COLOURS[model], label=label)
            axes.axhline(envelope.tyre_limits[f], color=GREEN, lw=1.2, ls="-.", label="tyre limit")
            axes.plot([], [], "-", color=FAINT, label="straight")
            axes.plot([], [], "--", color=FAINT, label="curved")
            panel(axes, f"valid up to, friction {envelope.frictions[f]:g}", "m/s²").set_xlabel("speed [m/s]")
            axes.set_ylim(0.0, 1.05 * envelope.tyre_limits.max())
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure
