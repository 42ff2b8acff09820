"""What the model does not know: constant disturbances and less friction, learned from one step to the next.

Two states one step apart give the forces that the axles really had. What the tyre model lacks of them at the rear is
learned as a force on the whole car, split like its weight: bank or side wind. What then is missing at the front comes
from an angle of its wheels that no sensor sees: a misaligned steering. What the actuator lacks of its command is an
angle that the sensor does see. After the first second all are learned slowly against the car's own motion: the steady
part of a mismatch is taken, transients are left alone.
"""

import math
from typing import NamedTuple

from sidestep.controller.mpc.car_model import Car, axle_force, slip_angles
from sidestep.controller.mpc.prediction import SLOWEST, tyre_lag
from sidestep.controller.mpc.roll import felt, lateral_acceleration
from sidestep.plant_models.kernels import kernel

DISTURBANCE_TIME = 0.8
"""Time constant of the disturbance estimate, in [s]."""
FIRST_STEPS = 5.0
"""The estimate begins as a mean, in which knowing nothing counts as one step less than these, until the time constant
is reached."""
MAX_SHARE, MAX_ANGLE = 0.15, 0.05
"""Largest estimates: force as a share of the weight, and each angle in [rad]."""
LINEAR_SHARE = 0.5
"""Forces are learned while both slip angles are below this share of their bound: beyond it, less friction
looks like a force."""
FRICTION_TIME = 0.15
"""Time constant with which the friction bound falls, in [s]."""
FRICTION_RECOVERY = 0.01
"""Speed with which it rises again while nothing speaks against it, in [1/s]."""
UTILISED = 0.45
"""Share of the front slip bound from which on the axle forces tell about friction."""
MODEL_ERROR = 0.1
"""Shortfall of the real force that still passes for an error of the tyre model, as a share."""
LEAST_FRICTION = 0.1


class Disturbance(NamedTuple):
    """Estimate of what acts on the car beside the model.

    Attributes:
        actuator: Road-wheel angle that the sensor shows less the commanded one, at rest, in [rad].
        sensor: Road-wheel angle that the tyres have less what the sensor shows, in [rad].
        share: Lateral force on the car, as a share of its weight.
        steps: Since the start.
    """

    actuator: float = 0.0
    sensor: float = 0.0
    share: float = 0.0
    steps: float = 0.0

    @property
    def angle(self) -> float:
        """Road-wheel angle that the tyres have less the commanded one, at rest, in [rad]."""
        return self.actuator + self.sensor

    def forces(self, car: Car) -> tuple[float, float]:
        """At the front and the rear axle, in [N]."""
        return self.share * car.load_f, self.share * car.load_r


@kernel
def real_forces(before, now, v, period, car):
    """Lateral axle forces between two states, from Newton's and Euler's law.

    Args:
        before, now: States of `prediction`, shape (6,).
        v, period: Speed in [m/s] and time between the two in [s].
        car: Car.

    Returns:
        Front and rear force, in [N].
    """
    lateral = car.mass * lateral_acceleration(before, now, v, period)
    moment = car.yaw_inertia * (now[3] - before[3]) / period
    wheelbase = car.l_f + car.l_r
    return (car.l_r * lateral + moment) / wheelbase, (car.l_f * lateral - moment) / wheelbase


@kernel
def _model_forces(before, now, sensor, roll, v, period, car):
    lag = tyre_lag(v, car.stiffness_f + car.stiffness_r, car)
    middle = 0.5 * (before + now) - lag / period * (now - before)
    aside, moved_f, moved_r = felt(roll[0], roll[1], car.body)
    front, rear = slip_angles(middle[2] + aside / v, middle[3], middle[4] + sensor, v, car)
    force_f = axle_force(front, car.stiffness_f, car.load_f, car, moved_f)
    return front, rear, force_f, axle_force(rear, car.stiffness_r, car.load_r, car, moved_r)


@kernel
def _towards(estimate, target, gain, limit):
    return min(max(estimate + gain * (target - estimate), -limit), limit)


@kernel
def observe_disturbance(estimate, before, now, roll, speed, period, car, slip_limits):
    """One step of the disturbance observer.

    Args:
        estimate: Disturbance of the step before.
        before, now: States of `prediction` at the last and this step, shape (6,); before[5] is the command
            that was in force in between, [4] what the sensor shows.
        roll: Roll angle and rate meanwhile, in [rad] and [rad/s].
        speed: v, in [m/s].
        period: Between the two states, in [s].
        car: Car.
        slip_limits: Front and rear, in [rad].

    Returns:
        The fields of Disturbance.
    """
    v = max(speed, SLOWEST)
    actuator, sensor, share, steps = estimate
    gain = max(period / DISTURBANCE_TIME, 1.0 / (FIRST_STEPS + steps))
    left = math.exp(-period / car.lag) if car.lag > 1e-3 else 0.0
    if abs(now[4] - before[4]) < 0.9 * car.rate_limit * period:
        towards = (now[4] - before[4] * left) / (1.0 - left)  # the angle that the actuator went for
        actuator = _towards(actuator, towards - before[5], gain, MAX_ANGLE)
    slip_f, slip_r, model_f, model_r = _model_forces(before, now, sensor, roll, v, period, car)
    if abs(slip_f) < LINEAR_SHARE * slip_limits[0] and abs(slip_r) < LINEAR_SHARE * slip_limits[1]:
        real_f, real_r = real_forces(before, now, v, period, car)
        missing = real_f - model_f - share * car.load_f
        sensor = _towards(sensor, sensor + missing / car.stiffness_f, gain, MAX_ANGLE)
        share = _towards(share, (real_r - model_r) / car.load_r, gain, MAX_SHARE)
    return actuator, sensor, share, steps + 1.0


@kernel
def observe_friction(before, now, sensor, roll, speed, period, car, slip_limits, believed):
    """One step of the estimate of the friction's upper bound.

    Where the tyres are used, the force that the car really has bounds the friction from above: less than the
    tyre model's says that the road gives less.

    Args:
        before, now: States of `prediction` at the last and this step, shape (6,); [4] what the sensor shows.
        sensor: See Disturbance, in [rad].
        roll, speed, period: As of `observe_disturbance`.
        car: Car, whose friction is the estimate of the step before.
        slip_limits: Front and rear at that friction, in [rad].
        believed: The estimate never exceeds this.
    """
    v = max(speed, SLOWEST)
    slip_f, _, model_f, model_r = _model_forces(before, now, sensor, roll, v, period, car)
    real_f, real_r = real_forces(before, now, v, period, car)
    if abs(slip_f) > UTILISED * slip_limits[0] and model_f * model_r > 0.0:
        share = (real_f + real_r) / (model_f + model_r) + MODEL_ERROR
        if share < 1.0:
            fallen = car.friction * (1.0 - period / FRICTION_TIME * (1.0 - max(share, 0.0)))
            return max(fallen, min(LEAST_FRICTION, believed))
    return min(car.friction + FRICTION_RECOVERY * period, believed)
