"""Validity envelope of a measured car: up to which lateral acceleration each model of the controller predicts it.

A cell is a range of speed and of the mean lateral acceleration over the horizon, as the drive happened to have them;
its figure is the 95th percentile of the lateral error HORIZON_TIME ahead over its starting points, as on plants. What
the sensors and an unknown bank add is in it: a limit of zero says that the log cannot vouch for the buffer there.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.model_error.envelope import crossing
from sidestep.validation.model_error.identification.car_kernel import Values
from sidestep.validation.model_error.logs.measured import PERIOD, MeasuredLog
from sidestep.validation.model_error.measured.scores import LEAST_STARTS, Starts, measured_v_y, p95
from sidestep.validation.model_error.prediction_error import HORIZON_TIME, road_states
from sidestep.validation.model_error.prediction_models import MODELS, predict
from sidestep.validation.report.style import BLUE, INK, ORANGE, styled

Array = NDArray[np.float64]

SPEED_STEP, ACCELERATION_STEP = 5.0, 1.0
"""Of the cells, in [m/s] and [m/s^2]."""
_TICKS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
_COLOURS = {"linear": INK, "euler": ORANGE, "affine": BLUE}


@dataclass(frozen=True, eq=False)
class LogEnvelope:
    """What came out.

    Attributes:
        speeds: Middles of the ranges with data, shape (s,), in [m/s].
        accelerations: Middles, shape (a,), in [m/s^2].
        errors: 95th percentiles, shape (models, s, a), in [m]; NaN without data.
        buffer: Of the corridor, in [m].
        all_errors: Of every starting point, shape (models, w), in [m].
    """

    speeds: Array
    accelerations: Array
    errors: Array
    buffer: float
    all_errors: Array

    def largest(self) -> Array:
        """Acceleration up to which the error stays within the buffer, shape (models, s), in [m/s^2]."""
        return np.array([[self._limit(row) for row in model] for model in self.errors])

    def _limit(self, row: Array) -> float:
        there = np.isfinite(row)
        last = int(np.flatnonzero(there)[-1]) + 1 if there.any() else 0
        return crossing(self.accelerations[:last][there[:last]], row[:last][there[:last]], self.buffer) if last else 0.0

    def as_tables(self, log: str) -> dict[str, Any]:
        """For validity.json, which `controller.validity` reads; one friction, that of the drive."""
        errors = [[[None if np.isnan(e) else float(e) for e in row] for row in model] for model in self.errors]
        return {
            "plant": log,
            "buffer": self.buffer,
            "horizon": HORIZON_TIME,
            "speed": self.speeds.tolist(),
            "friction": [1.0],
            "max_lateral_acceleration": {m: [row] for m, row in zip(MODELS, self.largest().tolist(), strict=True)},
            "lateral_acceleration": self.accelerations.tolist(),
            "p95_error": {"measured": dict(zip(MODELS, errors, strict=True))},
        }


def log_envelope(
    log: MeasuredLog, values: Values, vehicle: VehicleParameters, starts: Starts, buffer: float
) -> LogEnvelope:
    """Predict from every starting point with the controller's models.

    Args:
        log: The log.
        values: The car and its sensors: offsets, delays and steering gain are taken out of what was measured.
        vehicle: The car as the controller knows it.
        starts: Starting points.
        buffer: Of the corridor, in [m].
    """
    length = round(HORIZON_TIME / PERIOD)
    place = np.arange(len(log.time))
    steer = np.interp(place - values.steer_delay / PERIOD, place, log.signals["steer"])
    speed, rate = log.signals["v_x"], log.signals["yaw_rate"] - values.yaw_rate_offset
    aside = measured_v_y(log, values) if "v_y" in log.signals else _steady_v_y(speed, rate, vehicle)
    window = starts.index[:, None] + np.arange(length + 1)
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (rate[1:] + rate[:-1]))])
    v_y = aside[window]
    path = _path(yaw[window], speed[window], v_y)
    truth = road_states(
        {"x": path[0], "y": path[1], "yaw": yaw[window], "v_x": speed[window], "v_y": v_y, "yaw_rate": rate[window]},
        0.0,
    )  # fmt: skip
    begin = truth[:, 0].copy()
    smooth = log.signals["start_yaw_rate"] - values.yaw_rate_offset
    begin[:, 3] = smooth[starts.index]
    angles = values.steer_gain * steer[window] + values.steer_offset
    errors = np.array([
        predict(m, vehicle, 1.0, begin, speed[starts.index], angles, 0.0)[:, -1, 0] - truth[:, -1, 0] for m in MODELS
    ])  # fmt: skip
    return _in_cells(starts, errors, buffer)


def _steady_v_y(speed: Array, rate: Array, vehicle: VehicleParameters) -> Array:
    """Where no sideslip is measured: that of a steady turn."""
    rear = vehicle.mass * vehicle.l_f / vehicle.wheelbase * speed * rate
    return vehicle.l_r * rate - speed * rear / vehicle.cornering_stiffness_rear


def _path(yaw: Array, speed: Array, v_y: Array) -> tuple[Array, Array]:
    """Positions along every window, shape (w, n), in [m]."""
    ahead, left = speed * np.cos(yaw) - v_y * np.sin(yaw), speed * np.sin(yaw) + v_y * np.cos(yaw)
    start = np.zeros((len(yaw), 1))

    def integrated(rate: Array) -> Array:
        return np.concatenate([start, np.cumsum(0.5 * PERIOD * (rate[:, 1:] + rate[:, :-1]), axis=1)], axis=1)

    return integrated(ahead), integrated(left)


def _in_cells(starts: Starts, errors: Array, buffer: float) -> LogEnvelope:
    speed_cell = np.floor(starts.speed / SPEED_STEP).astype(int)
    lateral_cell = np.floor(starts.lateral / ACCELERATION_STEP).astype(int)
    speeds = [c for c in np.unique(speed_cell) if (speed_cell == c).sum() >= LEAST_STARTS]
    cells = np.full((len(errors), len(speeds), int(lateral_cell.max()) + 1), np.nan)
    for i, c in enumerate(speeds):
        for a in range(cells.shape[2]):
            chosen = (speed_cell == c) & (lateral_cell == a)
            cells[:, i, a] = [p95(model, chosen) for model in errors]
    middles: list[Array] = [np.array(speeds) + 0.5, np.arange(cells.shape[2], dtype=np.float64) + 0.5]
    return LogEnvelope(SPEED_STEP * middles[0], ACCELERATION_STEP * middles[1], cells, buffer, errors)


def envelope_figure(found: LogEnvelope) -> Figure:
    """Error over lateral acceleration, a panel per model, a line per range of speed."""
    with styled():
        figure = Figure(figsize=(11.0, 3.4), layout="constrained")
        panels = figure.subplots(1, len(MODELS), sharey=True)
        shades = np.linspace(0.25, 1.0, max(len(found.speeds), 1))
        for axes, model, errors in zip(panels, MODELS, found.errors, strict=True):
            for row, speed, shade in zip(errors, found.speeds, shades, strict=True):
                label = f"{speed:g} m/s"
                axes.plot(
                    found.accelerations, row, ".-", color=_COLOURS[model], alpha=float(shade), lw=1.1, label=label
                )
            axes.axhline(found.buffer, color=INK, lw=1.2, ls="--")
            axes.set(yscale="log", xlabel="lateral acceleration [m/s²]", title=f"{model}  [m]")
            axes.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
            axes.minorticks_off()
        panels[0].set_ylabel(f"p95 of the lateral error {HORIZON_TIME:g} s ahead")
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title="darker is faster")
    return figure
