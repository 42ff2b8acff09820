"""The speed control of every plant: proportional, within the car's limits of braking and driving.

The same law is written in C in the single-track FMU; a plant that follows another one cannot be compared.
"""

from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.vehicle.parameters import VehicleParameters

SPEED_GAIN = 2.0
"""Acceleration per speed error, in [1/s]."""


@kernel
def limited_acceleration(speed: float, target_speed: float, max_braking: float, max_acceleration: float) -> float:
    """clip(SPEED_GAIN (target_speed - speed), -max_braking, max_acceleration), in [m/s^2]; for kernels."""
    return min(max(SPEED_GAIN * (target_speed - speed), -max_braking), max_acceleration)


def longitudinal_acceleration(speed: float, target_speed: float, vehicle: VehicleParameters) -> float:
    """Acceleration that the speed control asks for, in [m/s^2], at a speed and target in [m/s]."""
    return limited_acceleration(speed, target_speed, vehicle.max_braking, vehicle.max_acceleration)
