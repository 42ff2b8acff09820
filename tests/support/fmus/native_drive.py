"""Drive a native FMU, and read what it computes on the way."""

from dataclasses import astuple

import numpy as np

from sidestep.plant_models.signals import SteeringCommand


def drive(plant, start, command, duration, dt=0.02):
    """States from the reset on, one a row: time, x, y, yaw, v_x, v_y, yaw_rate, steer_angle."""
    rows = [plant.reset(start)]
    for k in range(round(duration / dt)):
        rows.append(plant.step(SteeringCommand(0.0, *command(k * dt)), dt))
    return np.array([astuple(row) for row in rows])


def read(plant, *names):
    """Values of further variables of the FMU."""
    port = plant._fmu.port(list(names))
    plant._fmu.get(port)
    return np.array(port.values)
