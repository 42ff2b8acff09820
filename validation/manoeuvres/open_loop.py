"""Open-loop drives of a plant: its signals over time."""

from dataclasses import astuple, fields

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.mpc.car_model import Car
from sidestep.controller.mpc.prediction import steady_gain
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.loop.recording import SAMPLE_UNITS
from sidestep.validation.loop.start import reset_at
from sidestep.validation.manoeuvres.catalogue import Manoeuvre

Array = NDArray[np.float64]
Response = dict[str, Array]
"""Signals by name: those of VehicleState, steer_command, lateral_acceleration, and roll if the plant reports it."""

PERIOD = 0.01
"""Time between samples, over which a command is held, in [s]."""
CORRECTION = 2.0
"""Gain by which a driver corrects the steering to the radius, in [1/s]."""

RESPONSE_UNITS = {**SAMPLE_UNITS, "roll": "rad"}
_COLUMNS = (*(f.name for f in fields(VehicleState)), "steer_command", "roll")


def steer_angle(lateral_acceleration: float, speed: float, vehicle: VehicleParameters) -> float:
    """Angle [rad] that holds a lateral acceleration [m/s^2] at a speed [m/s] in the linear model, within the limit."""
    angle = lateral_acceleration / steady_gain(speed, Car.of(vehicle, affine=False, friction=1.0))
    return min(max(angle, -vehicle.steer_limit), vehicle.steer_limit)


def steady_acceleration(steer_angle: float, speed: float, vehicle: VehicleParameters) -> float:
    """Lateral acceleration [m/s^2] that an angle [rad], cut to the limit, holds in the linear model."""
    angle = min(max(steer_angle, -vehicle.steer_limit), vehicle.steer_limit)
    return angle * steady_gain(speed, Car.of(vehicle, affine=False, friction=1.0))


def drive(
    plant: Plant, manoeuvre: Manoeuvre, vehicle: VehicleParameters, commands: int = 1, substeps: int = 1
) -> Response:
    """Drive one manoeuvre.

    Args:
        plant: Is reset first.
        manoeuvre: What to drive.
        vehicle: The car by whose linear model amplitudes become angles.
        commands: Per sample; many make the steering smooth between the samples.
        substeps: Plant steps per command, to see what the step size does.

    Returns:
        Signals, shape (n,), one sample every PERIOD. The acceleration is v_y' + v_x gamma.

    Raises:
        InputError: The plant does not start at the manoeuvre's speed and heading.
        PlantError: The plant cannot start or go on.
    """
    hold = PERIOD / commands
    times: Array = hold * np.arange(round(manoeuvre.duration / PERIOD) * commands + 1.0)
    angles = _angles(manoeuvre, vehicle, times).tolist()
    state, correction = reset_at(plant, _start(manoeuvre, vehicle)), 0.0
    signals = getattr(plant, "signals", None)
    rows = []
    for k, angle in enumerate(angles):
        if manoeuvre.radius:
            correction += CORRECTION * hold * (1.0 / manoeuvre.radius - state.yaw_rate / max(state.v_x, 1.0))
            angle += vehicle.wheelbase * correction
        if k % commands == 0:
            rows.append((*astuple(state), angle, signals()["roll"] if signals else 0.0))
        if k < len(angles) - 1:
            command = SteeringCommand(state.time, angle, _speed(manoeuvre, times[k], state))
            for _ in range(substeps):
                state = plant.step(command, hold / substeps)
    response = dict(zip(_COLUMNS, np.array(rows).T, strict=True))
    response["lateral_acceleration"] = np.gradient(response["v_y"], PERIOD) + response["v_x"] * response["yaw_rate"]
    if not signals:
        del response["roll"]
    return response


def _angles(manoeuvre: Manoeuvre, vehicle: VehicleParameters, times: Array) -> Array:
    """Commanded angle over time, in [rad]."""
    if manoeuvre.radius:
        return np.full(len(times), vehicle.wheelbase / manoeuvre.radius)
    amplitude, bend = (
        steer_angle(a, manoeuvre.speed, vehicle) for a in (manoeuvre.lateral_acceleration, manoeuvre.bend)
    )
    return np.clip(bend + amplitude * manoeuvre.shape(times), -vehicle.steer_limit, vehicle.steer_limit)


def _start(manoeuvre: Manoeuvre, vehicle: VehicleParameters) -> VehicleState:
    """Straight on, or steady in the bend as the linear model has it."""
    v = manoeuvre.speed
    yaw_rate = v / manoeuvre.radius if manoeuvre.radius else manoeuvre.bend / v
    rear_force = vehicle.mass * vehicle.l_f / vehicle.wheelbase * v * yaw_rate
    v_y = vehicle.l_r * yaw_rate - v * rear_force / vehicle.cornering_stiffness_rear
    angle = steer_angle(v * yaw_rate, v, vehicle)
    return VehicleState(v_x=v, v_y=v_y, yaw_rate=yaw_rate, steer_angle=angle)


def _speed(manoeuvre: Manoeuvre, time: float, state: VehicleState) -> float:
    """Target speed in [m/s]; the present one asks for neither throttle nor brake."""
    if manoeuvre.coasts:
        return state.v_x
    if manoeuvre.final_speed is None:
        return manoeuvre.speed
    return manoeuvre.speed + (manoeuvre.final_speed - manoeuvre.speed) * min(time / manoeuvre.duration, 1.0)
