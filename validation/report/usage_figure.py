"""How much of car and model a run used: accelerations, sideslip, and how far predictions were off."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sidestep.plant_models.vehicle.parameters import GRAVITY
from sidestep.validation.loop.recording import Array, Recording
from sidestep.validation.report.style import BLUE, FAINT, INK, ORANGE, RED, panel, styled
from sidestep.validation.scenarios.scenario import Scenario

FASTEST_SHOWN = 1.0
"""Below this speed sideslip is not defined well, in [m/s]."""


def usage_figure(scenario: Scenario, recording: Recording) -> Figure:
    """Friction circle, phase plane of sideslip, and error of the predicted offset over the horizon."""
    with styled():
        figure = Figure(figsize=(11.0, 3.6))
        figure.subplots_adjust(0.05, 0.14, 0.99, 0.9, wspace=0.22)
        circle, plane, fan = figure.subplots(1, 3)
        draw_friction_circle(circle, scenario, recording)
        draw_phase_plane(plane, recording)
        draw_prediction_errors(fan, scenario, recording)
    return figure


def prediction_errors(recording: Recording) -> tuple[Array, Array]:
    """How far the predicted lateral offset was from the driven one.

    Returns:
        Times ahead, shape (N + 1,), in [s]; errors, shape (k, N + 1), in [m], of the plans whose whole horizon was
        driven and of one length of horizon.
    """
    whole = [plan for plan in recording.plans if plan.time + plan.states_time[-1] <= recording["time"][-1] + 1e-9]
    if not whole:
        return np.zeros(0), np.zeros((0, 0))
    ahead = whole[0].states_time
    same = [plan for plan in whole if len(plan.states_time) == len(ahead)]
    driven = np.interp(np.array([plan.time + ahead for plan in same]), recording["time"], recording["l"])
    return ahead, np.array([plan.states[:, 0] for plan in same]) - driven


def draw_friction_circle(axes: Axes, scenario: Scenario, recording: Recording) -> None:
    """Acceleration forward over that to the left, in [m/s^2], within the tyres' peak."""
    panel(axes, "Accelerations, forward over left", "m/s²")
    time, v_x = recording["time"], recording["v_x"]
    along = np.gradient(v_x, time) - recording["v_y"] * recording["yaw_rate"] if len(time) > 1 else 0.0 * v_x
    axes.plot(recording["lateral_acceleration"], along, color=BLUE, linewidth=1.0)
    reach = 1.1 * max(float(np.hypot(recording["lateral_acceleration"], along).max()), 1.0)
    if scenario.plant.kind != "linear":
        peak = scenario.plant.friction * scenario.vehicle.tyre.p_dy1 * GRAVITY
        angle = np.linspace(0.0, 2.0 * np.pi, 200)
        axes.plot(peak * np.cos(angle), peak * np.sin(angle), color=RED, linestyle="--", label="tyres' peak")
        reach = max(reach, 1.1 * peak)
        axes.legend(loc="lower left")
    axes.set(xlim=(reach, -reach), ylim=(-reach, reach), aspect="equal", xlabel="left  [m/s²]")  # left is left


def draw_phase_plane(axes: Axes, recording: Recording) -> None:
    """Yaw rate, in [deg/s], over sideslip, in [deg]."""
    panel(axes, "Yaw rate over sideslip", "deg/s")
    moving = recording["v_x"] > FASTEST_SHOWN
    sideslip = np.degrees(np.arctan2(recording["v_y"][moving], recording["v_x"][moving]))
    axes.plot(sideslip, np.degrees(recording["yaw_rate"][moving]), color=BLUE, linewidth=1.0)
    axes.set_xlabel("sideslip  [deg]")
    axes.axhline(0.0, color=FAINT, zorder=0)
    axes.axvline(0.0, color=FAINT, zorder=0)


def draw_prediction_errors(axes: Axes, scenario: Scenario, recording: Recording) -> None:
    """How far predictions of the offset were off, in [cm], over the time ahead, in [s], beside the buffer."""
    panel(axes, "Error of the predicted offset", "cm")
    ahead, errors = prediction_errors(recording)
    axes.set_xlabel("time ahead  [s]")
    if not len(errors):
        return
    size = 100.0 * np.abs(errors)
    for share, alpha in ((100.0, 0.12), (95.0, 0.25)):
        label = "largest" if share == 100.0 else "95 %"
        axes.fill_between(
            ahead, np.percentile(size, share, axis=0), color=BLUE, alpha=alpha, linewidth=0.0, label=label
        )
    axes.plot(ahead, np.median(size, axis=0), color=INK, label="median")
    axes.axhline(100.0 * scenario.controller.buffer, color=ORANGE, linestyle="--", label="buffer")
    axes.set_ylim(0.0, None)
    axes.legend(loc="upper left")
