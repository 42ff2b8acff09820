"""What the model does not know: constant disturbances, learned from one step to the next.

Two states one step apart give the forces that the axles really had. What the tyre model lacks of them at the rear is
learned as a force on the whole car, split like its weight: bank or side wind. What then is missing at the front comes
from an angle of its wheels that no sensor sees: a misaligned steering. What the actuator lacks of its command is an
angle that the sensor does see. After the first second all are learned slowly against the car's own motion: the steady
part of a mismatch is taken, transients are left alone.
"""

import math

from sidestep.controller.mpc.car_model import axle_force, slip_angles
from sidestep.controller.mpc.prediction import SLOWEST, tyre_lag
from sidestep.controller.mpc.roll import lateral_acceleration, roll_effects
from sidestep.plant_models.kernels import Array, Record, kernel

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


@kernel
def real_forces(before: Array, now: Array, v: float, period: float, car: Record) -> tuple[float, float]:
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
def _middle(before, now, i, share):
    return 0.5 * (before[i] + now[i]) - share * (now[i] - before[i])


@kernel
def _model_forces(before, now, sensor, roll, v, period, car):
    share = tyre_lag(v, car.stiffness_f + car.stiffness_r, car) / period
    roll_slip, moved_f, moved_r = roll_effects(roll[0], roll[1], car.body)
    beta, gamma, delta = _middle(before, now, 2, share), _middle(before, now, 3, share), _middle(before, now, 4, share)
    front, rear = slip_angles(beta + roll_slip / v, gamma, delta + sensor, v, car)
    force_f = axle_force(front, car.stiffness_f, car.load_f, car, moved_f)
    return front, rear, force_f, axle_force(rear, car.stiffness_r, car.load_r, car, moved_r)


@kernel
def _towards(estimate, target, gain, limit):
    return min(max(estimate + gain * (target - estimate), -limit), limit)


@kernel
def observe_disturbance(d: Record, before: Array, now: Array, roll: Array, v: float, period: float, c: Record) -> None:
    """One step of the disturbance observer.

    Args:
        d: Record of `DISTURBANCE`, overwritten: road-wheel angle that the sensor shows less the commanded one, at rest
            (`actuator`), and that the tyres have less what the sensor shows (`sensor`), in [rad]; lateral force as a
            share of the car's weight; steps since the start.
        before, now: States of `prediction` at the last and this step, shape (6,); before[5] is the command
            that was in force in between, [4] what the sensor shows.
        roll: Roll angle and rate meanwhile, in [rad] and [rad/s].
        v: Speed, in [m/s].
        period: Between the two states, in [s].
        c: Settings: car and slip limits.
    """
    car, v = c.car, max(v, SLOWEST)
    gain = max(period / DISTURBANCE_TIME, 1.0 / (FIRST_STEPS + d.steps))
    left = math.exp(-period / car.lag) if car.lag > 1e-3 else 0.0
    if abs(now[4] - before[4]) < 0.9 * car.rate_limit * period:
        towards = (now[4] - before[4] * left) / (1.0 - left)  # the angle that the actuator went for
        d.actuator = _towards(d.actuator, towards - before[5], gain, MAX_ANGLE)
    slip_f, slip_r, model_f, model_r = _model_forces(before, now, d.sensor, roll, v, period, car)
    if abs(slip_f) < LINEAR_SHARE * c.slip_limits[0] and abs(slip_r) < LINEAR_SHARE * c.slip_limits[1]:
        real_f, real_r = real_forces(before, now, v, period, car)
        missing = real_f - model_f - d.share * car.load_f
        d.sensor = _towards(d.sensor, d.sensor + missing / car.stiffness_f, gain, MAX_ANGLE)
        d.share = _towards(d.share, (real_r - model_r) / car.load_r, gain, MAX_SHARE)
    d.steps += 1.0
