"""What the controller knows of the car: inertia, geometry, actuator and axle forces.

An axle is two tyres at half its static load, or more and less when the body rolls. Its force is either linear
in the slip angle, as in the paper, or the Magic Formula, which the prediction replaces by its tangent at the
slip angle of the last plan.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.mpc.roll import Body
from sidestep.plant_models.kernels import Record, kernel
from sidestep.plant_models.tyres.formula import cornering_stiffness, lateral_force
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

SLOPE_STEP = 1e-5
"""Half the step of the central difference that gives a tangent, in [rad]."""
PEAK_STEP = 5e-4
"""Accuracy of the peak's slip angle, in [rad]."""
MOST_MOVED = 0.45
"""Share of an axle's load that can go from one wheel to the other: with half of it the inner wheel lifts."""
LEAST_SHARE = 0.05
"""A tangent is at least this share of the slope at zero slip: steering must keep its effect beyond the peak."""


class Car(NamedTuple):
    """Data of the prediction model, SI units; axle stiffness and load per axle.

    Attributes:
        affine: Whether axle forces are tangents to the Magic Formula; linear in the slip angle if not.
        tyre: See TyreParameters.as_array.
        friction: That the controller believes, as a factor on the tyre's peak.
        body: How it rolls.
        relaxation: Distance that a tyre rolls before its force follows its slip, in [m].
    """

    mass: float
    yaw_inertia: float
    l_f: float
    l_r: float
    stiffness_f: float
    stiffness_r: float
    lag: float
    load_f: float
    load_r: float
    steer_limit: float
    rate_limit: float
    affine: bool
    tyre: NDArray[np.void]
    friction: float
    body: Body = Body()
    relaxation: float = 0.0

    @classmethod
    def of(cls, vehicle: VehicleParameters, affine: bool, friction: float, body: Body | None = None) -> "Car":
        """The car of a vehicle file; without `body` nothing rolls."""
        per_length = vehicle.mass * GRAVITY / vehicle.wheelbase
        return cls(
            mass=vehicle.mass, yaw_inertia=vehicle.yaw_inertia, l_f=vehicle.l_f, l_r=vehicle.l_r,
            stiffness_f=vehicle.cornering_stiffness_front, stiffness_r=vehicle.cornering_stiffness_rear,
            lag=vehicle.steer_time_constant, load_f=per_length * vehicle.l_r, load_r=per_length * vehicle.l_f,
            steer_limit=vehicle.steer_limit, rate_limit=vehicle.steer_rate_limit,
            affine=affine, tyre=vehicle.tyre.as_array(), friction=friction,
            body=body or Body(), relaxation=vehicle.tyre.relaxation_y if affine else 0.0,
        )  # fmt: skip


@kernel
def axle_force(slip: float, stiffness: float, load: float, car: Record, moved: float = 0.0) -> float:
    """Lateral force of an axle, in [N].

    Args:
        slip: Slip angle, in [rad].
        stiffness, load: Of the axle at rest, in [N/rad] and [N]: with either tyre model the slope at zero slip.
        car: Car.
        moved: Load that went from one wheel to the other, in [N]; none of it counts with linear tyres.
    """
    if not car.affine:
        return stiffness * slip
    scale = 0.5 * stiffness / cornering_stiffness(0.5 * load, car.tyre)
    if moved == 0.0:
        return 2.0 * lateral_force(slip, 0.5 * load, car.friction, car.tyre, scale)
    moved = min(abs(moved), MOST_MOVED * load)
    force = lateral_force(slip, 0.5 * load + moved, car.friction, car.tyre, scale)
    return force + lateral_force(slip, 0.5 * load - moved, car.friction, car.tyre, scale)


@kernel
def least_slope(stiffness: float, load: float, car: Record) -> float:
    """Slope that a tangent of an axle has at least, in [N/rad]; arguments as of `axle_force`."""
    return LEAST_SHARE * axle_force(SLOPE_STEP, stiffness, load, car) / SLOPE_STEP


@kernel
def tangent(
    slip: float, least: tuple[float, float], stiffness: float, load: float, car: Record, moved: float = 0.0
) -> tuple[float, float]:
    """Slope [N/rad], not below `least`, and force at zero slip [N] of the line that touches the axle's force.

    Arguments as of `axle_force`.
    """
    if not car.affine:
        return stiffness, 0.0
    below = axle_force(slip - SLOPE_STEP, stiffness, load, car, moved)
    above = axle_force(slip + SLOPE_STEP, stiffness, load, car, moved)
    slope = max((above - below) / (2.0 * SLOPE_STEP), least)
    return slope, 0.5 * (above + below) - slope * slip


@kernel
def slip_angles(beta: float, yaw_rate: float, steer: float, speed: float, car: Record) -> tuple[float, float]:
    """Front and rear slip angle, in [rad], as in Eq. (2) and (3)."""
    return steer - beta - car.l_f * yaw_rate / speed, -beta + car.l_r * yaw_rate / speed


@kernel
def peak_slip(stiffness: float, load: float, car: Record) -> float:
    """Slip angle at which the Magic Formula of an axle peaks, in [rad]; 45 deg if it never falls again."""
    best, slip, scale = 0.0, 0.0, 0.5 * stiffness / cornering_stiffness(0.5 * load, car.tyre)
    while slip < 0.25 * math.pi:
        slip += PEAK_STEP
        force = lateral_force(slip, 0.5 * load, car.friction, car.tyre, scale)
        if force < best:
            break
        best = force
    return slip
