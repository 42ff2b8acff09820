"""Figures of open-loop drives, as the ISO standards for passenger cars define them.

Gradients are slopes of least-squares lines over GRADIENT_RANGE of lateral acceleration, times of the response count
from when the steering passes half of its final angle. Angles in [rad], accelerations in [m/s^2].
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.manoeuvres.open_loop import Response

Array = NDArray[np.float64]

GRADIENT_RANGE = (0.2 * GRAVITY, 0.4 * GRAVITY)
"""Lateral acceleration over which gradients are taken, in [m/s^2]."""
STEADY_TIME = 1.0
"""End of a step response that counts as steady, in [s]."""


@dataclass(frozen=True)
class Gradients:
    """Steady-state behaviour (ISO 4138).

    Attributes:
        understeer: d delta / d a_y - L / v^2 at constant speed, d delta / d a_y on a circle, in [rad s^2/m].
        sideslip: d beta / d a_y, in [rad s^2/m].
        roll: d phi / d a_y, in [rad s^2/m]; NaN if the plant does not report roll.
    """

    understeer: float
    sideslip: float
    roll: float


@dataclass(frozen=True)
class StepResponse:
    """Of one signal to a step of the steering (ISO 7401).

    Attributes:
        steady: Mean over STEADY_TIME at the end, in the signal's unit.
        response_time: Until 90 % of it, T90, in [s].
        peak_time: Until the peak, in [s].
        overshoot: Of the peak over the steady value, as a share of it.
    """

    steady: float
    response_time: float
    peak_time: float
    overshoot: float


@dataclass(frozen=True)
class Weave:
    """On-centre behaviour (ISO 13674-1).

    Attributes:
        sensitivity: d a_y / d delta where a_y passes 0, in [m/s^2/rad].
        dead_band: Width of the loop of delta over a_y, where a_y is 0, in [rad].
        lag: By which a_y follows delta, in [s].
    """

    sensitivity: float
    dead_band: float
    lag: float


@dataclass(frozen=True)
class DwellResponse:
    """Stability and responsiveness in a sine with dwell (FMVSS 126, ISO 19365).

    Attributes:
        after_1_00, after_1_75: Yaw rate 1.00 s and 1.75 s after the steering is back, over its second peak; a car
            that passes has no more than 0.35 and 0.20.
        displacement: To the side, 1.07 s after the steering begins, in [m]; 1.83 m at least.
    """

    after_1_00: float
    after_1_75: float
    displacement: float


def gradients(response: Response, vehicle: VehicleParameters) -> Gradients:
    """Understeer, sideslip and roll gradient of a slowly increasing steer or a circle.

    Raises:
        InputError: The drive does not cover GRADIENT_RANGE.
    """
    a_y = response["lateral_acceleration"]
    side = np.sign(a_y[-1])
    inside = (side * a_y > GRADIENT_RANGE[0]) & (side * a_y < GRADIENT_RANGE[1])
    if np.count_nonzero(inside) < 10:
        reached = f"lateral accelerations up to {np.abs(a_y).max():.2f} m/s²"
        raise InputError("gradients", reached, f"a drive through {GRADIENT_RANGE[0]:.2f} to {GRADIENT_RANGE[1]:.2f}")
    speed, rate = response["v_x"][inside], response["yaw_rate"][inside]
    ackermann = vehicle.wheelbase * rate / speed  # L / R, at constant speed L a_y / v^2

    def slope(values: Array) -> float:
        return float(np.polyfit(a_y[inside], values, 1)[0])

    return Gradients(
        slope(response["steer_angle"][inside] - ackermann),
        slope(response["v_y"][inside] / speed),
        slope(response["roll"][inside]) if "roll" in response else math.nan,
    )


def step_response(response: Response, signal: str = "yaw_rate") -> StepResponse:
    """T90, peak time and overshoot of one signal.

    Raises:
        InputError: The signal does not answer: no steering, or its 90 % are not reached.
    """
    time, steer, values = response["time"], response["steer_angle"], response[signal]
    last = time > time[-1] - STEADY_TIME
    steady = float(values[last].mean())
    if steer[-1] == 0.0 or steady == 0.0:
        raise InputError("step response", f"{signal} or the steering ends at 0", "a step of the steering")
    half, ninety = _first(time, steer / steer[-1], 0.5), _first(time, values / steady, 0.9)
    peak = int(np.argmax(values / steady))
    return StepResponse(steady, ninety - half, float(time[peak]) - half, max(float(values[peak]) / steady - 1.0, 0.0))


def _first(time: Array, values: Array, level: float) -> float:
    """When a signal first reaches a level, linear between samples."""
    k = int(np.argmax(values >= level))
    if values[k] < level:
        raise InputError("step response", f"{level:.0%} of the end is not reached", "a longer drive")
    return float(np.interp(level, values[k - 1 : k + 1], time[k - 1 : k + 1])) if k else float(time[0])


def tb_factor(response: Response) -> float:
    """Peak time of the yaw rate times steady sideslip, in [s rad] (ISO 7401)."""
    last = response["time"] > response["time"][-1] - STEADY_TIME
    sideslip = float(np.mean(response["v_y"][last] / response["v_x"][last]))
    return step_response(response, "yaw_rate").peak_time * abs(sideslip)


def weave(response: Response) -> Weave:
    """On-centre figures of a weave; its first quarter is left out."""
    keep = response["time"] >= 0.25 * response["time"][-1]
    time, steer, a_y = (response[name][keep] for name in ("time", "steer_angle", "lateral_acceleration"))
    rising, falling = (_passes(a_y, side, steer) for side in (1.0, -1.0))
    near = np.abs(a_y) < 0.5 * np.abs(a_y).max()
    cycle = float(np.mean(np.diff(_passes(steer, 1.0, time))))
    wave = np.exp(-2j * math.pi * time / cycle) * np.hanning(len(time))
    turn = float(np.angle((wave @ steer) / (wave @ a_y)))
    return Weave(
        float(np.polyfit(steer[near], a_y[near], 1)[0]),
        abs(float(np.mean(rising)) - float(np.mean(falling))),
        turn / (2.0 * math.pi) * cycle,
    )


def _passes(values: Array, side: float, other: Array) -> list[float]:
    """Another signal's values where `values` passes 0 upwards (side 1) or downwards (-1)."""
    k = np.flatnonzero((side * values[:-1] < 0.0) & (side * values[1:] >= 0.0))
    share = values[k] / (values[k] - values[k + 1])
    return (other[k] + share * (other[k + 1] - other[k])).tolist()


def dwell_response(response: Response) -> DwellResponse:
    """Yaw rates after, and displacement in, a sine with dwell."""
    time, rate, steer = response["time"], response["yaw_rate"], response["steer_command"]
    moving = np.flatnonzero(steer != 0.0)
    begin, end = float(time[moving[0] - 1]), float(time[moving[-1] + 1])
    reversed_ = np.sign(steer) == -np.sign(steer[moving[0]])
    second = rate[np.flatnonzero(reversed_)[np.argmax(np.abs(rate[reversed_]))]]

    def at(instant: float, values: Array) -> float:
        return float(np.interp(instant, time, values))

    displacement = abs(at(begin + 1.07, response["y"]) - at(begin, response["y"]))
    return DwellResponse(at(end + 1.0, rate) / float(second), at(end + 1.75, rate) / float(second), displacement)


def asymmetry(left: Response, right: Response, signal: str = "yaw_rate") -> float:
    """Largest difference between a drive and its mirror image, over the largest value."""
    return float(np.abs(left[signal] + right[signal]).max() / np.abs(left[signal]).max())


def deceleration(response: Response) -> float:
    """Mean over a drive, in [m/s^2]."""
    return float((response["v_x"][0] - response["v_x"][-1]) / (response["time"][-1] - response["time"][0]))
