"""Checks that need to know nothing of the car: life cycle, clock, axes, signs, and signals that agree."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, replace

import numpy as np

from sidestep.plant_models.checks.driving import (
    DT,
    NAMES,
    STEER,
    TIME,
    V_X,
    V_Y,
    YAW,
    YAW_RATE,
    X,
    Y,
    drive,
    seen_from_start,
)
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState

ELSEWHERE = VehicleState(time=3.0, x=12.0, y=-7.0, yaw=2.0, v_x=15.0)
IN_A_BEND = replace(ELSEWHERE, v_y=0.5, yaw_rate=0.5, steer_angle=0.1)
AT_ORIGIN = VehicleState(v_x=10.0)
_JUMPS = {V_X: 0.5, V_Y: 0.25, YAW_RATE: 0.25, STEER: 0.03}
"""No car changes by more within 10 ms."""


def reset(plant: Plant, dt: float = DT, placed: Sequence[str] = NAMES) -> Iterator[str]:
    """The state after the reset is the one that was asked for, signal by signal, and the motion goes on from it."""
    got = plant.reset(IN_A_BEND)
    tolerances = (1e-9, 0.01, 0.01, 0.005, 0.1, 0.05, 0.01, 0.005)
    for name, tolerance in zip(NAMES, tolerances, strict=True):
        asked, found = getattr(IN_A_BEND, name), getattr(got, name)
        if name in placed and not abs(found - asked) <= tolerance:
            yield f"After reset, {name} is {found:.6g} instead of {asked:g}."
    step = 0.5 * dt
    following = plant.step(SteeringCommand(got.time, IN_A_BEND.steer_angle, IN_A_BEND.v_x), step)
    for column, jump in _JUMPS.items():
        before, after = astuple(got)[column], astuple(following)[column]
        if NAMES[column] in placed and not abs(after - before) <= jump * max(step / 0.01, 1.0):
            yield (
                f"{NAMES[column]} jumps from {before:.3g} after the reset to {after:.3g} in {step:g} s: "
                "the reset reports what it does not set."
            )


def clock(plant: Plant, dt: float = DT) -> Iterator[str]:
    """Time moves by the step."""
    for step in (dt, 0.5 * dt):
        ticks = np.diff(drive(plant, ELSEWHERE, 0.0, 15.0, 10.0 * step, step)[:, TIME])
        worst = ticks[np.argmax(np.abs(ticks - step))]
        if not abs(worst - step) <= 1e-9:
            yield f"A step of {step:g} s moves time by {worst:.6g} s."


def determinism(plant: Plant, dt: float = DT) -> Iterator[str]:
    """The same again gives the same bits."""
    first, second = (drive(plant, AT_ORIGIN, 0.03, 11.0, 1.0, dt) for _ in range(2))
    for row, column in np.argwhere(first != second)[:1]:
        yield (
            f"The same commands after the same reset give another {NAMES[column]} after {row * dt:.2f} s: "
            f"{first[row, column]!r}, then {second[row, column]!r}."
        )


def straight_driving(plant: Plant, dt: float = DT) -> Iterator[str]:
    """Without steering it goes where it points, as fast as it says."""
    states = drive(plant, ELSEWHERE, 0.0, 15.0, 2.0, dt)
    end = seen_from_start(states)[-1]
    if not (abs(end[Y]) <= 0.02 and abs(end[YAW]) <= 0.002):
        yield f"With zero steering the car drifts {end[Y]:.3g} m to the left and turns by {end[YAW]:.3g} rad in 30 m."
    if not abs(end[X] - 30.0) <= 0.6:
        yield f"2 s at 15 m/s move the car {end[X]:.4g} m along its yaw of {states[0, YAW]:.4g} rad instead of 30 m."


def signs(plant: Plant, dt: float = DT) -> Iterator[str]:
    """Left is positive, the angle told is the angle reported, and right mirrors left."""
    left, right = (seen_from_start(drive(plant, AT_ORIGIN, steer, 10.0, 1.5, dt)) for steer in (0.03, -0.03))
    for column in (STEER, YAW_RATE, YAW, Y):
        if not left[-1, column] > 0.0:
            yield f"Steering 0.03 rad to the left gives a {NAMES[column]} of {left[-1, column]:.3g}, not positive."
    if not abs(left[-1, STEER] - 0.03) <= 0.0015:
        yield f"1.5 s after a command of 0.03 rad, steer_angle is {left[-1, STEER]:.4g} rad."
    mirrored = right * np.array([1, 1, -1, -1, 1, -1, -1, -1])
    for column in (X, Y, YAW, V_X, V_Y, YAW_RATE, STEER):
        apart = np.abs(left - mirrored)[:, column].max()
        if not apart <= 0.02 * np.abs(left[:, column]).max() + 1e-3:
            yield f"Left and right turns are no mirror images: {NAMES[column]} differs by up to {apart:.3g}."


def motion(plant: Plant, dt: float = DT) -> Iterator[str]:
    """Position and yaw are the integrals of the velocities that are reported."""
    step = 0.5 * dt
    states = drive(plant, AT_ORIGIN, 0.05, 10.0, 2.0, step)
    c, s = np.cos(states[:, YAW]), np.sin(states[:, YAW])
    v_x, v_y = states[:, V_X], states[:, V_Y]
    rates = ((X, v_x * c - v_y * s, 0.03), (Y, v_x * s + v_y * c, 0.03), (YAW, states[:, YAW_RATE], 0.005))
    for column, rate, tolerance in rates:
        change, integral = states[-1, column] - states[0, column], np.trapezoid(rate, dx=step)
        if not abs(change - integral) <= tolerance:
            yield f"In a bend {NAMES[column]} changes by {change:.4g}, but its velocity integrates to {integral:.4g}."


def continuous_yaw(plant: Plant, dt: float = DT) -> Iterator[str]:
    """Yaw goes on through a half turn and a whole one, either way."""
    for yaw, steer in ((math.pi - 0.1, 0.05), (0.1 - math.pi, -0.05), (math.tau - 0.1, 0.05), (0.1, -0.05)):
        found = drive(plant, replace(AT_ORIGIN, yaw=yaw), steer, 10.0, 1.5, dt)[:, YAW]
        jump = int(np.argmax(np.abs(np.diff(found))))
        if not abs(found[jump + 1] - found[jump]) <= 1.0:
            yield f"yaw jumps from {found[jump]:.4g} to {found[jump + 1]:.4g} rad: it must go on, not wrap."
            return


def speed_control(plant: Plant, dt: float = DT) -> Iterator[str]:
    """The target speed is reached and held."""
    for target in (8.0, 12.0):
        reached = drive(plant, AT_ORIGIN, 0.0, target, 5.0, dt)[-1, V_X]
        if not abs(reached - target) <= 0.4:
            yield f"5 s after target_speed went from 10 to {target:g} m/s, v_x is {reached:.4g} m/s."


def step_splitting(plant: Plant, dt: float = DT) -> Iterator[str]:
    """Two halves of a step are a step."""
    whole = drive(plant, AT_ORIGIN, 0.03, 11.0, 1.0, dt)[-1]
    halves = drive(plant, AT_ORIGIN, 0.03, 11.0, 1.0, 0.5 * dt)[-1]
    for column in (X, Y, YAW, V_X, YAW_RATE, STEER):
        if not abs(whole[column] - halves[column]) <= 0.01 * abs(whole[column]) + 1e-3:
            yield (
                f"{NAMES[column]} after 1 s depends on the step: {whole[column]:.6g} with {dt:g} s, "
                f"{halves[column]:.6g} with {0.5 * dt:g} s."
            )


def commands_that_are_nan(plant: Plant, dt: float = DT) -> Iterator[str]:
    """What cannot be followed is not followed."""
    drive(plant, AT_ORIGIN, 0.03, 10.0, 0.5, dt)
    for steer, speed in ((math.nan, 10.0), (0.03, math.nan), (math.inf, math.inf)):
        state = plant.step(SteeringCommand(0.0, steer, speed), dt)
        if not state.is_finite():
            yield f"A command of {steer} rad and {speed} m/s makes the state NaN or infinite; hold the last one."
            return


def closing(plant: Plant) -> Iterator[str]:
    """It is its own context manager, and closes twice."""
    with plant as entered:
        if entered is not plant:
            yield f"The context manager gives {type(entered).__name__} instead of the plant itself."
    plant.close()


CONVENTIONS = (
    clock, determinism, straight_driving, signs, motion, continuous_yaw, speed_control, step_splitting,
    commands_that_are_nan,
)  # fmt: skip
