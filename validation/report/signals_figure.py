"""Signals over time, after the paper's Fig. 5: steering with its limits, states, acceleration, step times."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status
from sidestep.plant_models.vehicle.parameters import GRAVITY
from sidestep.validation.judge.verdict import Judgement
from sidestep.validation.loop.recording import SAMPLE_UNITS, Array, Recording
from sidestep.validation.report.style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    RED,
    legend,
    panel,
    styled,
    timeline,
)
from sidestep.validation.scenarios.scenario import Scenario


def signals_figure(scenario: Scenario, recording: Recording, judgement: Judgement) -> Figure:
    """Steering angle and rate, lateral offset, angles, yaw rate, a_y, speed; and how long the steps took."""
    with styled():
        figure = Figure(figsize=(11.0, 9.0))
        figure.subplots_adjust(0.045, 0.05, 0.995, 0.97, wspace=0.1, hspace=0.38)
        axes = list(figure.subplots(4, 2).flat)
        _steering(axes[0], axes[1], scenario, recording)
        _offset(axes[2], scenario, recording)
        _states(axes[3:7], scenario, recording)
        _step_times(axes[7], recording)
        for one in axes[:7]:
            timeline(one).set_xlim(recording["time"][0], max(recording["time"][-1], 0.1))
            _marks(one, recording, judgement)
        for one in axes[5:7]:
            one.set_xlabel("time  [s]")
        axes[7].set_xlabel("time of one step  [µs]")
    return figure


def draw_signal(axes: Axes, recording: Recording, name: str, **line: Any) -> None:
    """One signal over time; angles and their rates in degrees.

    Args:
        axes: To draw in.
        recording: Of a run.
        name: Column of `SAMPLE_UNITS`, such as "yaw_rate".
        line: Further arguments of the line, such as `color`.

    Raises:
        InputError: No such signal.
    """
    if name not in SAMPLE_UNITS:
        raise InputError("signal", f"{name!r}", ", ".join(SAMPLE_UNITS))
    unit = SAMPLE_UNITS[name]
    scale = math.degrees(1.0) if unit.startswith("rad") else 1.0
    timeline(panel(axes, name.replace("_", " "), unit.replace("rad", "deg").replace("^2", "²")))
    axes.plot(recording["time"], scale * recording[name], **{"color": BLUE, **line})
    axes.set_xlabel("time  [s]")


def _degrees(values: Array) -> Array:
    return np.degrees(values)


def _limits(axes: Axes, limit: float | Array, time: Array, label: str) -> None:
    for sign in (1.0, -1.0):
        axes.plot(time, np.full_like(time, sign) * limit, color=RED, linestyle="--", linewidth=1.0,
                  label=label if sign > 0.0 else None)  # fmt: skip


def _steering(angle: Axes, rate: Axes, scenario: Scenario, recording: Recording) -> None:
    time, vehicle = recording["time"], scenario.vehicle
    panel(angle, "Steering angle", "deg")
    angle.plot(time, _degrees(recording["steer_command"]), color=ORANGE, drawstyle="steps-post", label="commanded")
    angle.plot(time, _degrees(recording["steer_angle"]), color=BLUE, label="realised")
    bound = np.arctan(
        vehicle.wheelbase * scenario.controller.max_lateral_acceleration / np.maximum(recording["v_x"], 1.0) ** 2
    )
    _limits(angle, _degrees(np.minimum(bound, vehicle.steer_limit)), time, "limit of Eq. (14)")
    reach = 1.15 * math.degrees(max(np.abs(recording["steer_angle"]).max(), min(bound[0], vehicle.steer_limit)))
    angle.set_ylim(-reach, reach)
    legend(angle)
    panel(rate, "Steering rate", "deg/s")
    rate.plot(time, _degrees(recording["steer_rate"]), color=BLUE)
    _limits(rate, math.degrees(vehicle.steer_rate_limit), time, "actuator's limit")
    legend(rate)


def _offset(axes: Axes, scenario: Scenario, recording: Recording) -> None:
    panel(axes, "Lateral offset", "m")
    if recording.plans:
        met = np.array([(p.time, p.right[0], p.left[0], p.s[0]) for p in recording.plans])
        widths = scenario.path.widths(met[:, 3])
        right, left = (np.clip(met[:, i], -widths[1], widths[0]) for i in (1, 2))
        axes.fill_between(met[:, 0], right, left, color=GREEN, alpha=0.2, linewidth=0.0, step="post", label="corridor")
    axes.plot(recording["time"], recording["l"], color=BLUE, label="centre of gravity")
    legend(axes)


def _states(axes: Sequence[Axes], scenario: Scenario, recording: Recording) -> None:
    time = recording["time"]
    angles, yaw_rate, acceleration, speed = axes
    panel(angles, "Heading error and sideslip", "deg")
    angles.plot(time, _degrees(recording["heading_error"]), color=BLUE, label="heading error")
    sideslip = np.arctan2(recording["v_y"], np.maximum(recording["v_x"], 0.1))
    angles.plot(time, _degrees(sideslip), color=PURPLE, label="sideslip")
    legend(angles)
    panel(yaw_rate, "Yaw rate", "deg/s").plot(time, _degrees(recording["yaw_rate"]), color=BLUE)
    panel(acceleration, "Lateral acceleration", "m/s²").plot(time, recording["lateral_acceleration"], color=BLUE)
    grip = scenario.plant.friction * scenario.vehicle.tyre.p_dy1 * GRAVITY
    if scenario.plant.kind != "linear":
        _limits(acceleration, grip, time, "tyres' peak")
        legend(acceleration)
    panel(speed, "Speed", "m/s")
    speed.plot(time, recording["target_speed"], color=ORANGE, drawstyle="steps-post", label="target")
    speed.plot(time, recording["v_x"], color=BLUE, label="driven")
    low, high = speed.get_ylim()
    speed.set_ylim(min(low, 0.8 * scenario.speed), max(high, 1.1 * scenario.speed))
    legend(speed)


def _step_times(axes: Axes, recording: Recording) -> None:
    panel(axes, "Controller steps", "number")
    times = recording.steps["step_time"]
    if not len(times):
        return
    median, p99 = np.percentile(times, (50, 99))
    end = 1.5 * p99  # the last bin takes what is beyond
    axes.hist(np.minimum(times, end), bins=np.linspace(0.0, end, 60).tolist(), color=BLUE, alpha=0.75)
    axes.axvline(median, color=INK, label=f"median {median:.0f} µs")
    axes.axvline(p99, color=RED, label=f"p99 {p99:.0f} µs")
    legend(axes)


def _marks(axes: Axes, recording: Recording, judgement: Judgement) -> None:
    """A dotted line at the closest approach; a tint where the controller was not simply tracking."""
    if judgement.time is not None:
        axes.axvline(judgement.time, color=FAINT, linestyle=":", linewidth=1.4, zorder=0)
    low, high = axes.get_ylim()
    worse = recording["status"] > Status.TRACKING
    axes.fill_between(
        recording["time"], low, high, where=worse.tolist(), color=ORANGE, alpha=0.12, linewidth=0.0, zorder=0
    )
    axes.set_ylim(low, high)
