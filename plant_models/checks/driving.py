"""Driving a plant that may take no start state: what all checks share."""

from dataclasses import astuple, fields

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState

Array = NDArray[np.float64]

NAMES = [f.name for f in fields(VehicleState)]
TIME, X, Y, YAW, V_X, V_Y, YAW_RATE, STEER = range(8)
DT = 0.02
"""Usual step of the checks, in [s]."""
RUN_UP, TAKEN = 30.0, 0.5
"""Longest time to reach a speed that the reset did not set [s], and how far from it counts as set [m/s]."""


def drive(plant: Plant, start: VehicleState, steer: float, speed: float, duration: float, dt: float = DT) -> Array:
    """States from the start on under a held command, one a row of `NAMES`.

    A plant that ignores the start's speed is first driven straight on until it has it.

    Args:
        plant: Is reset first.
        start: Asked for.
        steer: Command, in [rad].
        speed: Target, in [m/s].
        duration: In [s].
        dt: Step, in [s].
    """
    state = plant.reset(start)
    for _ in range(round(RUN_UP / dt)):
        if abs(state.v_x - start.v_x) <= TAKEN:
            break
        state = plant.step(SteeringCommand(state.time, 0.0, start.v_x), dt)
    states = [state]
    for _ in range(round(duration / dt)):
        states.append(plant.step(SteeringCommand(states[-1].time, steer, speed), dt))
    return np.array([astuple(state) for state in states])


def seen_from_start(states: Array) -> Array:
    """The same with position and yaw as seen from the first row."""
    c, s = np.cos(states[0, YAW]), np.sin(states[0, YAW])
    x, y = (states[:, [X, Y]] - states[0, [X, Y]]).T
    result = states.copy()
    result[:, X], result[:, Y], result[:, YAW] = c * x + s * y, c * y - s * x, states[:, YAW] - states[0, YAW]
    return result


def steady(states: Array, dt: float, last: float = 0.5) -> VehicleState:
    """Mean of the last half second, or of `last` [s]."""
    return VehicleState(*states[-round(last / dt) :].mean(axis=0).tolist())


def asked_for(name: str, factor: float) -> str:
    """Where a factor between two signals often comes from, as a half sentence; empty if it is none of these."""
    known = {
        -1.0: "the sign is turned", 57.2958: "degrees for radians", 1.0 / 57.2958: "radians for degrees",
        3.6: "km/h for m/s", 1.0 / 3.6: "m/s for km/h", 1000.0: "millimetres for metres",
    }  # fmt: skip
    for value, meaning in known.items():
        if abs(factor / value - 1.0) <= 0.12:
            return f" ({meaning}?)"
    if name == "steer_angle" and (10.0 <= factor <= 25.0 or 0.04 <= factor <= 0.1):
        return " (a steering-wheel angle, whose ratio is not told?)"
    return ""
