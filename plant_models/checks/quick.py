"""The quick part of the checks, before a drive: one gentle bend at the speed of the drive.

It finds what makes a drive worthless (a turned sign, a wrong unit, a ratio that is not told) and what looks odd. Small
deviations (a few per cent of ratio, a reference point, tyres) take `check_plant`.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sidestep.plant_models.checks.car import gain
from sidestep.plant_models.checks.driving import (
    V_X,
    V_Y,
    YAW,
    YAW_RATE,
    Array,
    X,
    Y,
    asked_for,
    drive,
    steady,
)
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BEND, DURATION = 1.0, 2.0
"""Lateral acceleration of the bend [m/s^2] and its length [s]."""
_WRONG = (0.4, 2.5)  # factors beyond which it is another signal, not another car


class Doubt(NamedTuple):
    """What was found.

    Attributes:
        sentence: With figures.
        is_certain: Whether a drive would be worthless; else it only looks odd.
    """

    sentence: str
    is_certain: bool


def quick_check(plant: Plant, vehicle: VehicleParameters, start: VehicleState, dt: float) -> list[Doubt]:
    """Drive one bend and compare what the plant reports with itself, with the command and with the car.

    Args:
        plant: Stays open.
        vehicle: The car that it is said to be.
        start: Of the drive; the bend begins there, straight on.
        dt: Step, in [s].

    Raises:
        PlantError: The plant cannot start or go on.
    """
    straight_on = replace(start, v_y=0.0, yaw_rate=0.0, steer_angle=0.0)
    angle = min(BEND / (start.v_x * gain(vehicle, start.v_x)), 0.5 * vehicle.steer_limit)
    states = drive(plant, straight_on, angle, start.v_x, DURATION, dt)
    return [*_angle(states, angle, dt), *_yaw(states, angle, vehicle, dt), *_position(states, dt)]


def _angle(states: Array, asked: float, dt: float) -> Iterator[Doubt]:
    factor = steady(states, dt).steer_angle / asked
    if not abs(factor - 1.0) <= 0.05:
        sentence = (
            f"outputs.steer_angle: {factor:.3g} times the {asked:.3g} rad that the wheels are told"
            f"{asked_for('steer_angle', factor)}"
        )
        yield Doubt(sentence, _is_wrong(factor))


def _yaw(states: Array, asked: float, vehicle: VehicleParameters, dt: float) -> Iterator[Doubt]:
    turned, rate = states[-1, YAW] - states[0, YAW], np.trapezoid(states[:, YAW_RATE], dx=dt)
    if not abs(rate - turned) <= 0.05 * abs(turned) + 0.002:
        factor = rate / turned if turned else math.inf
        sentence = f"outputs.yaw_rate: integrates to {factor:.3g} times the change of outputs.yaw"
        yield Doubt(sentence + asked_for("yaw_rate", factor), _is_wrong(factor))
    end = steady(states, dt)
    factor = end.yaw_rate / (gain(vehicle, max(end.v_x, 1.0)) * asked)
    if not abs(factor - 1.0) <= 0.2:
        sentence = f"inputs.steer_angle: the car turns {factor:.3g} times as much as {vehicle.name} by {asked:.3g} rad"
        yield Doubt(sentence + asked_for("steer_angle", factor), _is_wrong(factor))


def _position(states: Array, dt: float) -> Iterator[Doubt]:
    velocity = (states[:, V_X] + 1j * states[:, V_Y]) * np.exp(1j * states[:, YAW])
    expected = complex(np.trapezoid(velocity, dx=dt))
    moved = complex(states[-1, X] - states[0, X], states[-1, Y] - states[0, Y])
    if not abs(expected) > 0.0:
        yield Doubt("outputs.v_x: the car stands", True)
        return
    factor = abs(moved) / abs(expected)
    if not abs(factor - 1.0) <= 0.05:
        sentence = f"outputs.x, outputs.y: the car moves {factor:.3g} times as far as outputs.v_x says"
        yield Doubt(sentence + asked_for("v_x", factor), not 0.8 <= factor <= 1.25)
        return
    astray = float(np.angle(moved / expected)) if moved else math.pi
    if not abs(astray) <= 0.02:
        sentence = f"outputs.yaw: the car moves {astray:.3g} rad to the left of where yaw and velocity point"
        yield Doubt(sentence, abs(astray) > 0.05)


def _is_wrong(factor: float) -> bool:
    return not _WRONG[0] <= factor <= _WRONG[1]
