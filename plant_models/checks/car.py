"""Checks against the car that a plant is said to be: actuator, reference point, angle, slip, inertia, grip.

Motion alone tells ratios: stiffness per mass, inertia per mass. Where forces grow with the mass (tyres
whose stiffness follows the load, and a load that is spread like the car), a heavier car moves alike and is not found.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sidestep.plant_models.checks.driving import (
    DT,
    STEER,
    V_X,
    V_Y,
    YAW,
    YAW_RATE,
    Array,
    asked_for,
    drive,
    steady,
)
from sidestep.plant_models.linear.plant import LinearPlant, steered
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.tyres.formula import lateral_force
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

SLOW, FAST = 3.0, 20.0
"""Speeds at which a bend shows geometry, and tyres, in [m/s]."""
BEND = 2.0
"""Lateral acceleration of the fast bend, where tyres are linear, in [m/s^2]."""
LEAST_GRIP = 0.65
"""Share of the tyres' peak that a car reaches at least; load transfer takes up to a quarter."""
_ANGLE, _SLIP, _ROLLS = 0.04, 0.15, 0.01
_INERTIA = (0.8, 1.25)


def gain(vehicle: VehicleParameters, speed: float) -> float:
    """Steady yaw rate per road-wheel angle in the linear model, in [1/s]."""
    front, rear = vehicle.cornering_stiffness_front, vehicle.cornering_stiffness_rear
    understeer = vehicle.mass / vehicle.wheelbase * (vehicle.l_r / front - vehicle.l_f / rear)
    return speed / (vehicle.wheelbase + understeer * speed**2)


def small_step(vehicle: VehicleParameters) -> float:
    """A steering step that the actuator's lag answers, not its rate limit, in [rad]."""
    return max(vehicle.steer_rate_limit * vehicle.steer_time_constant, 0.01)


def reference_point(plant: Plant, vehicle: VehicleParameters, dt: float = DT) -> Iterator[str]:
    """The reference point is the centre of gravity, and the angle at the wheels is the one that is reported."""
    end = steady(drive(plant, VehicleState(v_x=SLOW), 0.1, SLOW, 4.0, dt), dt, dt)
    # Steady state of (5): the rear axle's slip takes a little from the kinematic l_r.
    slip = vehicle.mass * vehicle.l_f * SLOW**2 / (vehicle.wheelbase * vehicle.cornering_stiffness_rear)
    expected, found = vehicle.l_r - slip, end.v_y / end.yaw_rate
    if not abs(found - expected) <= 0.1:
        where = f"{abs(found - expected):.2g} m {'ahead of' if found > expected else 'behind'} the centre of gravity"
        yield f"In a slow bend v_y / yaw_rate is {found:.3g} m: the reference point lies {where}."
    factor = end.yaw_rate / (gain(vehicle, end.v_x) * math.tan(end.steer_angle))
    if not abs(factor - 1.0) <= _ANGLE:
        yield (
            f"In a slow bend the car turns {factor:.3g} times as much as its road-wheel angle of {end.steer_angle:.3g} "
            f"rad makes it{asked_for('steer_angle', factor)}: the steering ratio, or the wheelbase of "
            f"{vehicle.wheelbase:.4g} m, is another."
        )


def steering_limits(plant: Plant, vehicle: VehicleParameters, dt: float = DT) -> Iterator[str]:
    """The steering is as fast as the car's and goes as far: no more, no less."""
    limit, rate_limit = vehicle.steer_limit, vehicle.steer_rate_limit
    duration = 0.5 + 1.5 * limit / rate_limit
    angle = drive(plant, VehicleState(v_x=2.0), 2.0 * limit, 2.0, duration, dt)[:, STEER]
    rate, reached = np.abs(np.diff(angle)).max() / dt, np.abs(angle).max()
    if not rate <= 1.01 * rate_limit:
        yield f"steer_angle moves at {rate:.4g} rad/s, the car's limit is {rate_limit} rad/s."
    if not reached <= 1.01 * limit:
        yield f"steer_angle reaches {reached:.4g} rad, the car's limit is {limit} rad."
    if not rate >= 0.95 * rate_limit:
        yield f"steer_angle moves at no more than {rate:.4g} rad/s, the car's limit is {rate_limit} rad/s."
    elif not reached >= 0.95 * limit:
        yield f"steer_angle reaches no more than {reached:.4g} rad, the car's limit is {limit} rad."


def steering_lag(plant: Plant, vehicle: VehicleParameters, dt: float = DT) -> Iterator[str]:
    """Wheels and yaw follow a step of the command as late as the car's; late in the mean, dead time included."""
    step, h = small_step(vehicle), 0.5 * dt
    states = drive(plant, VehicleState(v_x=FAST), step, FAST, 3.0, h)
    with LinearPlant(vehicle) as linear:
        expected_yaw = _lateness(drive(linear, VehicleState(v_x=FAST), step, FAST, 3.0, h)[:, YAW_RATE], h)
    dead = vehicle.suspension.steer_delay if vehicle.suspension else 0.0
    times = (h * k for k in range(len(states)))
    told = [steered(0.0, step, time, vehicle.steer_time_constant, vehicle.steer_rate_limit) for time in times]
    expected_steer = _lateness(np.array(told), h) + dead
    rows = (
        ("steer_angle", STEER, expected_steer, 0.02 + 0.2 * expected_steer),
        ("yaw_rate", YAW_RATE, expected_yaw + dead, 0.06),
    )
    for name, column, expected, tolerance in rows:
        found = _lateness(states[:, column], h)
        if not abs(found - expected) <= tolerance:
            yield (
                f"{name} follows a step of the steering {found:.2g} s late instead of {expected:.2g} s: lag or delay "
                f"of the steering is not {vehicle.steer_time_constant:g} s."
            )
            return


def _lateness(signal: Array, dt: float) -> float:
    """Mean delay of a step response, in [s]: of a lag its time constant, of a dead time that."""
    change = signal - signal[0]
    return float(np.trapezoid(1.0 - change / change[-1], dx=dt)) if change[-1] else math.inf


class _Bend(NamedTuple):
    """A fast bend: slip angle per lateral force of both axles, and the inertia, over what the linear car has.

    The inertia is that of a plant that does not roll, and of one that rolls on the car's springs.
    """

    front: float
    rear: float
    inertia: float
    inertia_if_rolling: float


def _fast_bend(plant: Plant, vehicle: VehicleParameters, dt: float) -> _Bend:
    h = 0.5 * dt
    states = drive(plant, VehicleState(v_x=FAST), BEND / (FAST * gain(vehicle, FAST)), FAST, 4.0, h)
    speed, v_y, rate, steer = (states[:, column] for column in (V_X, V_Y, YAW_RATE, STEER))
    front = steer - (v_y + vehicle.l_f * rate) / speed
    rear = (vehicle.l_r * rate - v_y) / speed
    end = round(0.5 / h)
    sideways = vehicle.mass / vehicle.wheelbase * float(np.mean((speed * rate)[-end:]))
    slip_f, slip_r = float(front[-end:].mean()), float(rear[-end:].mean())
    inertia = math.nan
    if slip_f and slip_r:  # forces that belong to the steady slip angles, whatever the tyres are like
        turning = vehicle.l_f * vehicle.l_r * sideways * (front / slip_f - rear / slip_r)
        inertia = float(np.trapezoid(turning, dx=h) / rate[-end:].mean())
    # A body that rolls sways: the centre of gravity moves outwards over the axles, which looks like less slip.
    levers = vehicle.l_f * vehicle.l_r * sideways * (1.0 / slip_f - 1.0 / slip_r) if slip_f and slip_r else 0.0
    swayed = -levers * _sway(vehicle) * BEND / (FAST * float(rate[-end:].mean()))
    return _Bend(
        front=slip_f * vehicle.cornering_stiffness_front / (vehicle.l_r * sideways),
        rear=slip_r * vehicle.cornering_stiffness_rear / (vehicle.l_f * sideways),
        inertia=inertia / vehicle.yaw_inertia,
        inertia_if_rolling=(inertia + max(swayed, 0.0)) / vehicle.yaw_inertia,
    )


def _sway(vehicle: VehicleParameters) -> float:
    """Way of the centre of gravity over the axles per lateral acceleration, in [s^2]; about the road."""
    if vehicle.suspension is None:
        return 0.0
    sprung = vehicle.mass - vehicle.suspension.unsprung_mass_front - vehicle.suspension.unsprung_mass_rear
    stiffness = sum(vehicle.suspension.roll_of_axle(axle)[0] for axle in ("front", "rear"))
    moment = sprung * vehicle.cg_height
    return vehicle.cg_height * moment / max(stiffness - moment * GRAVITY, 0.1 * stiffness)


def mass_and_stiffness(plant: Plant, vehicle: VehicleParameters, dt: float = DT) -> Iterator[str]:
    """The axles slip as much as the car's mass, stiffnesses and inertia make them."""
    found = _fast_bend(plant, vehicle, dt)
    if max(abs(found.front), abs(found.rear)) < _ROLLS:
        yield "The car rolls without slip: it has neither tyres nor a mass."
        return
    for axle, factor in (("front", found.front), ("rear", found.rear)):
        if not 1.0 - _SLIP <= factor <= 1.0 + _SLIP:
            yield (
                f"In a bend of {BEND:g} m/s^2 the {axle} axle slips {factor:.3g} times as much as the car's: mass over "
                f"cornering_stiffness_{axle}, or the centre of gravity, is another."
            )
    if not (found.inertia <= _INERTIA[1] and found.inertia_if_rolling >= _INERTIA[0]):
        yield f"The car turns in as if its yaw_inertia over mass were {found.inertia:.3g} times what is told."


def grip(plant: Plant, vehicle: VehicleParameters, dt: float = DT) -> Iterator[str]:
    """The tyres hold what the car's do; more is a matter of the model, as with linear tyres."""
    load = 0.25 * vehicle.mass * GRAVITY
    tyre = vehicle.tyre.as_array()
    peak = max(lateral_force(0.005 * k, load, 1.0, tyre) for k in range(1, 100)) / load * GRAVITY
    angle = min(1.4 * peak / (FAST * gain(vehicle, FAST)), vehicle.steer_limit)
    states = drive(plant, VehicleState(v_x=FAST), angle, FAST, 4.0, dt)
    window = max(round(0.3 / dt), 1)
    velocity = (states[:, V_X] + 1j * states[:, V_Y]) * np.exp(1j * states[:, YAW])
    reached = float(np.abs(velocity[window:] - velocity[:-window]).max() / (window * dt))
    if not reached >= LEAST_GRIP * min(peak, FAST * gain(vehicle, FAST) * angle):
        yield (
            f"Steered beyond the limit at {FAST:g} m/s, the car reaches {reached:.3g} m/s^2; its tyres hold "
            f"{peak:.3g} m/s^2: friction or tyres are others."
        )


OF_THE_CAR = (reference_point, steering_limits, steering_lag, mass_and_stiffness, grip)
