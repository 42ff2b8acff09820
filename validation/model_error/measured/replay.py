"""Our controller on the log's own road and speed, driving the identified car: what would it have steered?

The road is the driven line, integrated from speed, yaw rate and sideslip of one stretch; speed is the driver's at every
moment. Steering alone is ours.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.model_error.identification.car_kernel import Chassis, Values, advance, targets
from sidestep.validation.model_error.logs.measured import PERIOD, MeasuredLog
from sidestep.validation.model_error.measured.scores import measured_v_y
from sidestep.validation.report.style import BLUE, INK, legend, panel, styled

Array = NDArray[np.float64]

LONGEST, LEAST = 40.0, 8.0
"""Of the stretch, in [s]."""
APART = 25.0
"""Least distance [m] of the road from itself, else its projection is not unique."""
LOST = 5.0
"""Distance [m] from the driven line at which a replay ends: at the driver's speed there is no way back."""
_SPACING = 4.0  # of the way-points, in [m]
_AHEAD = 150.0  # road beyond the end, in [m]


@dataclass(frozen=True, eq=False)
class Replay:
    """Both drivers over time, shape (n,).

    Attributes:
        time: In [s] of the log.
        driver, ours: Road-wheel angle, in [rad].
        offset: Of our car from the driven line, in [m].
        speed: In [m/s].
        status: Share of steps by status.
    """

    time: Array
    driver: Array
    ours: Array
    offset: Array
    speed: Array
    status: dict[str, float]

    @property
    def lost(self) -> bool:
        """Whether our car left the driven line for good."""
        return bool(np.abs(self.offset[-1]) > LOST)


def replay(log: MeasuredLog, values: Values, chassis: Chassis, vehicle: VehicleParameters) -> Replay | None:
    """Drive the busiest stretch; None if there is no usable one."""
    chosen = _stretch(log, values)
    if chosen is None:
        return None
    first, x, y, yaw = chosen
    n, config = len(x), ControllerConfig()
    path = ReferencePath.from_waypoints(_waypoints(x, y, yaw), closed=False)
    controller = SteeringController(vehicle, path, (), config)
    place = np.arange(len(log.time))
    on_time = np.interp(place - values.steer_delay / PERIOD, place, log.signals["steer"])
    driver = (values.steer_gain * on_time + values.steer_offset)[first : first + n]
    speed, along = log.signals["v_x"][first : first + n + 1], log.signals["a_x"][first : first + n + 1]
    p, c, every = np.array(values), np.array(chassis), round(config.period / PERIOD)
    rate = log.signals["start_yaw_rate"][first] - values.yaw_rate_offset
    v_y = float(measured_v_y(log, values)[first]) if "v_y" in log.signals else 0.0
    angle, aim = float(driver[0]), float(driver[0])
    force = targets(p, c, speed[0], along[0], v_y, rate, angle, False)
    car, pose = (v_y, rate, *force, 0.0, 0.0, *force), (float(x[0]), float(y[0]), float(yaw[0]))
    rows, near, counts = [], 0.0, dict[str, int]()
    for k in range(n - 1):
        if k % every == 0:
            state = VehicleState(k * PERIOD, *pose, float(speed[k]), float(car[0]), float(car[1]), angle)
            command = controller.step(state)
            aim = command.steer_angle
            counts[command.status.name] = counts.get(command.status.name, 0) + 1
        s, offset, _ = path.project(pose[0], pose[1], near)
        near = s
        rows.append((log.time[first + k], driver[k], angle, offset, speed[k]))
        end = _actuated(angle, aim, vehicle)
        v_x, a_x = _three(speed, k), _three(along, k)
        car = advance(p, c, car, v_x, a_x, (angle, 0.5 * (angle + end), end), 0.0, PERIOD, False)
        pose, angle = _moved(pose, v_x[1], car), end
        if abs(offset) > LOST:
            break
    total = sum(counts.values())
    time, theirs, ours, offset, held = np.array(rows).T
    return Replay(time, theirs, ours, offset, held, {name: count / total for name, count in counts.items()})


def _actuated(angle: float, aim: float, vehicle: VehicleParameters) -> float:
    lag = vehicle.steer_time_constant
    step = (aim - angle) * (1.0 if lag <= 0.0 else 1.0 - np.exp(-PERIOD / lag))
    largest = vehicle.steer_rate_limit * PERIOD
    return float(angle + min(max(step, -largest), largest))


def _three(values: Array, k: int) -> tuple[float, float, float]:
    return float(values[k]), float(0.5 * (values[k] + values[k + 1])), float(values[k + 1])


def _moved(pose: tuple[float, float, float], speed: float, car: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, yaw = pose
    middle = yaw + 0.5 * PERIOD * car[1]
    cos, sin = float(np.cos(middle)), float(np.sin(middle))
    return x + PERIOD * (speed * cos - car[0] * sin), y + PERIOD * (speed * sin + car[0] * cos), yaw + PERIOD * car[1]


def _stretch(log: MeasuredLog, values: Values) -> tuple[int, Array, Array, Array] | None:
    """First sample and driven line of the stretch with the most steering whose road keeps clear of itself."""
    best, chosen = 0.0, None
    for a, b in log.stretches(round(LEAST / PERIOD)):
        for first in range(a, b - round(LEAST / PERIOD), round(10.0 / PERIOD)):
            last = min(first + round(LONGEST / PERIOD), b - 1)
            line = _line(log, values, first, last)
            count = _clear(line[0], line[1])
            work = float(np.abs(log.signals["yaw_rate"][first : first + count]).sum())
            if count * PERIOD >= LEAST and work > best:
                best, chosen = work, (first, line[0][:count], line[1][:count], line[2][:count])
    return chosen


def _line(log: MeasuredLog, values: Values, first: int, last: int) -> tuple[Array, Array, Array]:
    span = slice(first, last)
    rate, speed = log.signals["yaw_rate"][span] - values.yaw_rate_offset, log.signals["v_x"][span]
    v_y = measured_v_y(log, values)[span] if "v_y" in log.signals else np.zeros(len(rate))
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (rate[1:] + rate[:-1]))])
    ahead, left = speed * np.cos(yaw) - v_y * np.sin(yaw), speed * np.sin(yaw) + v_y * np.cos(yaw)
    x, y = (np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (v[1:] + v[:-1]))]) for v in (ahead, left))
    return x, y, yaw


def _clear(x: Array, y: Array) -> int:
    """Samples before the road comes back to itself."""
    coarse = np.arange(0, len(x), 20)
    px, py = x[coarse], y[coarse]
    run = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(px), np.diff(py)))])
    for i in range(len(coarse)):
        far = run[:i] < run[i] - 4.0 * APART
        if far.any() and np.hypot(px[:i][far] - px[i], py[:i][far] - py[i]).min() < APART:
            return int(coarse[i])
    return len(x)


def _waypoints(x: Array, y: Array, yaw: Array) -> Array:
    """The line, smoothed, every few metres, and straight on beyond its end."""
    x, y = gaussian_filter1d(x, 25.0, mode="nearest"), gaussian_filter1d(y, 25.0, mode="nearest")
    run = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    at = np.arange(0.0, run[-1], _SPACING)
    points = np.column_stack([np.interp(at, run, x), np.interp(at, run, y)])
    heading = points[-1] - points[-2]
    steps = np.arange(1.0, _AHEAD / _SPACING)[:, None]
    return np.concatenate([points, points[-1] + steps * heading])


def replay_figure(found: Replay) -> Figure:
    """Both steering angles, and our distance from the driven line."""
    with styled():
        figure = Figure(figsize=(10.0, 5.2), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        panel(above, "road-wheel angle", "deg")
        above.plot(found.time, np.degrees(found.driver), color=INK, lw=1.0, label="driver")
        above.plot(found.time, np.degrees(found.ours), color=BLUE, lw=1.2, label="controller on the identified car")
        legend(above)
        panel(below, "our car left of the driven line", "m").plot(found.time, found.offset, color=BLUE)
        below.set_xlabel("time in the log [s]")
    return figure


def summary(found: Replay) -> dict[str, Any]:
    """Numbers for summary.json and the report."""
    difference = found.ours - found.driver
    return {
        "from_s": float(found.time[0]), "to_s": float(found.time[-1]),
        "steer_difference_rms_rad": float(np.sqrt(np.mean(difference**2))),
        "steer_correlation": float(np.corrcoef(found.ours, found.driver)[0, 1]),
        "offset_rms_m": float(np.sqrt(np.mean(found.offset**2))), "offset_max_m": float(np.abs(found.offset).max()),
        "lost": found.lost,
        "status": found.status,
    }  # fmt: skip
