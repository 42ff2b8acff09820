"""Drives of the MuJoCo plant, and what its signals say."""

import math
from dataclasses import astuple

import numpy as np

from sidestep.plant_models.mujoco.bodies import WHEELS
from sidestep.plant_models.signals import SteeringCommand
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
PUBLISHED = BMW.on_tyres(BMW.tyre.without_load_sensitivity())


def drive(plant, state, seconds, steer, speed, dt=0.01):
    """States after every step; `steer` an angle or a function of the time since the start."""
    states = []
    for k in range(round(seconds / dt)):
        angle = steer(k * dt) if callable(steer) else steer
        state = plant.step(SteeringCommand(state.time, angle, speed), dt)
        states.append(state)
    return states


def rows(states):
    return np.array([astuple(state) for state in states])


def by_wheel(signals, quantity):
    return np.array([signals[f"{quantity}_{name}"] for name in WHEELS])


def world_velocity(state):
    c, s = math.cos(state.yaw), math.sin(state.yaw)
    return np.array([c * state.v_x - s * state.v_y, s * state.v_x + c * state.v_y])
