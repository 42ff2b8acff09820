"""Conformance check of a plant: does it keep to the seams' conventions? Run it on your own plant.

findings = check_plant(MyPlant(), vehicle)      # [] when all is well
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import astuple, fields

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

_NAMES = [f.name for f in fields(VehicleState)]
_TIME, _X, _Y, _YAW, _V_X, _V_Y, _YAW_RATE, _STEER = range(8)
_DT = 0.02
_ELSEWHERE = VehicleState(time=3.0, x=12.0, y=-7.0, yaw=2.0, v_x=15.0)
_AT_ORIGIN = VehicleState(v_x=10.0)


def check_plant(plant: Plant, vehicle: VehicleParameters | None = None) -> list[str]:
    """Drive a plant through short manoeuvres and compare with what every plant promises.

    Checked are life cycle, clock, determinism, axes and signs (ISO 8855), that pose and velocity agree,
    speed control, commands that are NaN; with `vehicle` also the reference point and the steering limits.
    About 40 s of simulated time; the plant is closed at the end.

    Args:
        plant: The plant, without errors of its own such as a misaligned steering.
        vehicle: The car that it models, if known.

    Returns:
        One sentence for every finding, empty if there is none.
    """
    missing = [name for name in _METHODS if not callable(getattr(plant, name, None))]
    if missing:
        return [f"The plant has no method {', '.join(missing)}."]
    findings = [finding for check in _CHECKS for finding in _found(check, plant)]
    if vehicle is not None:
        findings += [finding for check in _CHECKS_OF_CAR for finding in _found(check, plant, vehicle)]
    return findings + _found(_closing, plant)


def _found(check: Callable[..., Iterator[str]], *arguments: object) -> list[str]:
    try:
        return list(check(*arguments))
    except Exception as error:  # whatever a stranger's plant raises is a finding
        return [f"The check of {check.__name__[1:].replace('_', ' ')} ended with {type(error).__name__}: {error}."]


def _drive(
    plant: Plant, start: VehicleState, steer: float, speed: float, duration: float, dt: float = _DT
) -> NDArray[np.float64]:
    """States from the reset on under a held command, one a row."""
    states = [plant.reset(start)]
    for _ in range(round(duration / dt)):
        states.append(plant.step(SteeringCommand(states[-1].time, steer, speed), dt))
    return np.array([astuple(state) for state in states])


def _reset(plant: Plant) -> Iterator[str]:
    got = plant.reset(_ELSEWHERE)
    tolerances = (1e-9, 0.01, 0.01, 0.005, 0.1, 0.05, 0.01, 0.005)
    for name, tolerance in zip(_NAMES, tolerances, strict=True):
        asked, found = getattr(_ELSEWHERE, name), getattr(got, name)
        if not abs(found - asked) <= tolerance:
            yield f"After reset, {name} is {found:.6g} instead of {asked:g}."


def _clock(plant: Plant) -> Iterator[str]:
    for dt in (0.02, 0.01):
        ticks = np.diff(_drive(plant, _ELSEWHERE, 0.0, 15.0, 0.2, dt)[:, _TIME])
        worst = ticks[np.argmax(np.abs(ticks - dt))]
        if not abs(worst - dt) <= 1e-9:
            yield f"A step of {dt} s moves time by {worst:.6g} s."


def _determinism(plant: Plant) -> Iterator[str]:
    first, second = (_drive(plant, _AT_ORIGIN, 0.03, 11.0, 1.0) for _ in range(2))
    for row, column in np.argwhere(first != second)[:1]:
        yield (
            f"The same commands after the same reset give another {_NAMES[column]} after {row * _DT:.2f} s: "
            f"{first[row, column]!r}, then {second[row, column]!r}."
        )


def _straight_driving(plant: Plant) -> Iterator[str]:
    states = _drive(plant, _ELSEWHERE, 0.0, 15.0, 2.0)
    dx, dy = states[-1, [_X, _Y]] - states[0, [_X, _Y]]
    c, s = math.cos(_ELSEWHERE.yaw), math.sin(_ELSEWHERE.yaw)
    ahead, left = dx * c + dy * s, dy * c - dx * s
    turned = states[-1, _YAW] - states[0, _YAW]
    if not (abs(left) <= 0.02 and abs(turned) <= 0.002):
        yield f"With zero steering the car drifts {left:.3g} m to the left and turns by {turned:.3g} rad in 30 m."
    if not abs(ahead - 30.0) <= 0.6:
        yield f"2 s at 15 m/s and yaw {_ELSEWHERE.yaw} rad move the car {ahead:.4g} m along that yaw instead of 30 m."


def _signs(plant: Plant) -> Iterator[str]:
    left, right = (_drive(plant, _AT_ORIGIN, steer, 10.0, 1.5) for steer in (0.03, -0.03))
    for column in (_STEER, _YAW_RATE, _YAW, _Y):
        if not left[-1, column] > 0.0:
            yield f"Steering 0.03 rad to the left gives a {_NAMES[column]} of {left[-1, column]:.3g}, not positive."
    if not abs(left[-1, _STEER] - 0.03) <= 0.0015:
        yield f"1.5 s after a command of 0.03 rad, steer_angle is {left[-1, _STEER]:.4g} rad."
    mirrored = right * np.array([1, 1, -1, -1, 1, -1, -1, -1])
    for column in (_X, _Y, _YAW, _V_X, _V_Y, _YAW_RATE, _STEER):
        apart = np.abs(left - mirrored)[:, column].max()
        if not apart <= 0.02 * np.abs(left[:, column]).max() + 1e-3:
            yield f"Left and right turns are no mirror images: {_NAMES[column]} differs by up to {apart:.3g}."


def _motion(plant: Plant) -> Iterator[str]:
    states = _drive(plant, _AT_ORIGIN, 0.05, 10.0, 2.0, 0.01)
    c, s = np.cos(states[:, _YAW]), np.sin(states[:, _YAW])
    v_x, v_y = states[:, _V_X], states[:, _V_Y]
    rates = ((_X, v_x * c - v_y * s, 0.03), (_Y, v_x * s + v_y * c, 0.03), (_YAW, states[:, _YAW_RATE], 0.005))
    for column, rate, tolerance in rates:
        change, integral = states[-1, column] - states[0, column], np.trapezoid(rate, dx=0.01)
        if not abs(change - integral) <= tolerance:
            yield f"In a bend {_NAMES[column]} changes by {change:.4g}, but its velocity integrates to {integral:.4g}."


def _speed_control(plant: Plant) -> Iterator[str]:
    for target in (8.0, 12.0):
        reached = _drive(plant, _AT_ORIGIN, 0.0, target, 5.0)[-1, _V_X]
        if not abs(reached - target) <= 0.4:
            yield f"5 s after target_speed went from 10 to {target:g} m/s, v_x is {reached:.4g} m/s."


def _step_splitting(plant: Plant) -> Iterator[str]:
    whole = _drive(plant, _AT_ORIGIN, 0.03, 11.0, 1.0)[-1]
    halves = _drive(plant, _AT_ORIGIN, 0.03, 11.0, 1.0, _DT / 2)[-1]
    for column in (_X, _Y, _YAW, _V_X, _YAW_RATE, _STEER):
        if not abs(whole[column] - halves[column]) <= 0.01 * abs(whole[column]) + 1e-3:
            yield (
                f"{_NAMES[column]} after 1 s depends on the step: {whole[column]:.6g} with {_DT} s, "
                f"{halves[column]:.6g} with {_DT / 2} s."
            )


def _commands_that_are_nan(plant: Plant) -> Iterator[str]:
    _drive(plant, _AT_ORIGIN, 0.03, 10.0, 0.5)
    for steer, speed in ((math.nan, 10.0), (0.03, math.nan), (math.inf, math.inf)):
        state = plant.step(SteeringCommand(0.0, steer, speed), _DT)
        if not state.is_finite():
            yield f"A command of {steer} rad and {speed} m/s makes the state NaN or infinite; hold the last one."
            return


def _reference_point(plant: Plant, vehicle: VehicleParameters) -> Iterator[str]:
    end = _drive(plant, VehicleState(v_x=3.0), 0.1, 3.0, 4.0)[-1]
    # Steady state of (5): the rear axle's slip takes a little from the kinematic l_r.
    slip = vehicle.mass * vehicle.l_f * 3.0**2 / (vehicle.wheelbase * vehicle.cornering_stiffness_rear)
    expected, found = vehicle.l_r - slip, end[_V_Y] / end[_YAW_RATE]
    if not abs(found - expected) <= 0.1:
        where = f"{abs(found - expected):.2g} m {'ahead of' if found > expected else 'behind'} the centre of gravity"
        yield f"In a slow bend v_y / yaw_rate is {found:.3g} m: the reference point lies {where}."


def _steering_limits(plant: Plant, vehicle: VehicleParameters) -> Iterator[str]:
    duration = 0.5 + 1.5 * vehicle.steer_limit / vehicle.steer_rate_limit
    angle = _drive(plant, VehicleState(v_x=2.0), 2.0 * vehicle.steer_limit, 2.0, duration)[:, _STEER]
    rate = np.abs(np.diff(angle)).max() / _DT
    if not rate <= 1.01 * vehicle.steer_rate_limit:
        yield f"steer_angle moves at {rate:.4g} rad/s, the car's limit is {vehicle.steer_rate_limit} rad/s."
    if not np.abs(angle).max() <= 1.01 * vehicle.steer_limit:
        yield f"steer_angle reaches {np.abs(angle).max():.4g} rad, the car's limit is {vehicle.steer_limit} rad."


def _closing(plant: Plant) -> Iterator[str]:
    with plant as entered:
        if entered is not plant:
            yield f"The context manager gives {type(entered).__name__} instead of the plant itself."
    plant.close()


_METHODS = ("reset", "step", "close", "__enter__", "__exit__")
_CHECKS = (
    _reset, _clock, _determinism, _straight_driving, _signs, _motion, _speed_control, _step_splitting,
    _commands_that_are_nan,
)  # fmt: skip
_CHECKS_OF_CAR = (_reference_point, _steering_limits)
