"""How every plant turns a command into an acceleration: as commanded, or by a proportional speed control.

Both within the car's limits of braking and driving. The same law is written in C for the FMUs; a plant that follows
another one cannot be compared.
"""

import math

from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.signals import SteeringCommand
from sidestep.plant_models.vehicle.parameters import VehicleParameters

SPEED_GAIN = 2.0
"""Acceleration per speed error where only a speed is commanded, in [1/s]."""
HOLD_SPEED = 0.1
"""Speed below which commanded brakes fade to nothing, as they hold a car that stands, in [m/s]."""


def drive_asked(command: SteeringCommand, held: tuple[float, float]) -> tuple[float, float]:
    """Target speed [m/s] and acceleration [m/s^2], NaN for none, that a command puts in force.

    Args:
        command: The new one; where neither number in it is finite what was held goes on.
        held: Both as they have been in force.
    """
    speed, acceleration = command.target_speed, command.acceleration
    if not math.isfinite(speed):
        return (held[0], acceleration) if math.isfinite(acceleration) else held
    return speed, acceleration if math.isfinite(acceleration) else math.nan


@kernel
def limited_acceleration(speed: float, target_speed: float, max_braking: float, max_acceleration: float) -> float:
    """clip(SPEED_GAIN (target_speed - speed), -max_braking, max_acceleration), in [m/s^2]; for kernels."""
    return min(max(SPEED_GAIN * (target_speed - speed), -max_braking), max_acceleration)


@kernel
def asked_acceleration(
    speed: float, target_speed: float, acceleration: float, max_braking: float, max_acceleration: float
) -> float:
    """Acceleration of a car under a command, in [m/s^2]; for kernels.

    Args:
        speed: Forward, in [m/s].
        target_speed: Followed by the speed control where no acceleration is given, in [m/s].
        acceleration: As commanded, in [m/s^2]; not finite if it is not given. Negative is braking: it acts against
            the motion, whichever way that goes, and fades below HOLD_SPEED.
        max_braking, max_acceleration: Limits, in [m/s^2].
    """
    if not math.isfinite(acceleration):
        return limited_acceleration(speed, target_speed, max_braking, max_acceleration)
    if acceleration >= 0.0:
        return min(acceleration, max_acceleration)
    return max(acceleration, -max_braking) * min(max(speed / HOLD_SPEED, -1.0), 1.0)


def longitudinal_acceleration(speed: float, target_speed: float, vehicle: VehicleParameters) -> float:
    """Acceleration that the speed control asks for, in [m/s^2], at a speed and target in [m/s]."""
    return limited_acceleration(speed, target_speed, vehicle.max_braking, vehicle.max_acceleration)
