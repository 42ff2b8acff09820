"""The linear plant: the paper's single track with linear tyres (5), driven in the plane.

The lateral dynamics is Eq. (5) written in v_y = beta v_x, which also holds while the speed changes; the
pose follows from exact kinematics. Below SLIP_SPEED the slip angle's denominator stays at that speed: the
equations no longer stiffen as v -> 0, the car then rolls like the kinematic bicycle, and nothing pushes it
at standstill.
"""

import math
from dataclasses import replace
from typing import Any, Self

import numpy as np

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.kernels import Array, Record, kernel
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.speed_control import asked_acceleration, drive_asked
from sidestep.plant_models.vehicle.parameters import VehicleParameters

SLIP_SPEED = 1.5
"""Speed below which the slip angle is regularised, in [m/s]."""

MAX_SUBSTEP = 2e-3
"""Longest Runge-Kutta step, in [s]."""


class LinearPlant:
    """Single track with linear tyres, steering lag and rate limit, and speed control; a `Plant`.

    A command that is not finite is ignored: the actuators hold the last one that was.
    """

    def __init__(self, vehicle: VehicleParameters, steer_offset: float = 0.0):
        """Build the plant; `reset` it before the first step.

        Args:
            vehicle: The car.
            steer_offset: Added to every commanded angle, in [rad]: a misaligned steering.
        """
        self._offset = steer_offset
        self._limit = vehicle.steer_limit
        self._parameters = np.array([
            vehicle.mass,
            vehicle.yaw_inertia,
            vehicle.l_f,
            vehicle.l_r,
            vehicle.cornering_stiffness_front,
            vehicle.cornering_stiffness_rear,
            vehicle.steer_time_constant,
            vehicle.steer_rate_limit,
            vehicle.max_braking,
            vehicle.max_acceleration,
        ])  # fmt: skip
        self._state: VehicleState | None = None
        self._motion = np.zeros(6)
        self._steer_command, self._drive = 0.0, (0.0, math.nan)

    def reset(self, state: VehicleState) -> VehicleState:
        """Start from `state`, its steering angle cut to the limit.

        Raises:
            PlantError: The state is not finite.
        """
        if not state.is_finite():
            raise PlantError(f"cannot start from a state that is not finite: {state}")
        steer = min(max(state.steer_angle, -self._limit), self._limit)
        self._steer_command, self._drive = steer, (state.v_x, math.nan)
        self._motion[:] = state.x, state.y, state.yaw, state.v_x, state.v_y, state.yaw_rate
        self._state = replace(state, steer_angle=steer)
        return self._state

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds.

        Raises:
            PlantError: Not reset yet, or the state grows beyond all bounds.
            InputError: dt is not a positive number.
        """
        state = self._state
        if state is None:
            raise PlantError("step before reset")
        if not 0.0 < dt < math.inf:
            raise InputError("dt", f"{dt} s", "> 0")
        if math.isfinite(command.steer_angle):
            self._steer_command = min(max(command.steer_angle + self._offset, -self._limit), self._limit)
        self._drive = drive_asked(command, self._drive)
        steer = advance(
            self._motion,
            state.steer_angle,
            self._steer_command,
            self._drive,
            dt,
            max(1, math.ceil(dt / MAX_SUBSTEP - 1e-9)),
            self._parameters,
        )
        x, y, yaw, v_x, v_y, yaw_rate = self._motion.tolist()
        following = VehicleState(state.time + dt, x, y, yaw, v_x, v_y, yaw_rate, steer)
        if not following.is_finite():
            raise PlantError(f"the car spins beyond all bounds after {state.time:.3f} s")
        self._state = following
        return following

    def close(self) -> None:
        """Nothing is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


@kernel
def steered(steer: float, command: float, elapsed: float, time_constant: float, rate_limit: float) -> float:
    """Road-wheel angle [rad] after `elapsed` seconds of a first-order lag behind a rate limit; exact."""
    gap = command - steer
    lag = rate_limit * time_constant
    if abs(gap) > lag:
        ramp = min(elapsed, (abs(gap) - lag) / rate_limit)
        steer += math.copysign(rate_limit * ramp, gap)
        elapsed -= ramp
        gap = command - steer
    if time_constant > 0.0:
        return command - gap * math.exp(-elapsed / time_constant)
    return command if elapsed > 0.0 else steer


@kernel
def advance(motion: Array, steer: float, command: float, drive: Any, dt: float, substeps: Any, p: Record) -> Any:
    """Runge-Kutta 4 over `dt`.

    Args:
        motion: x, y, yaw, v_x, v_y, yaw_rate; overwritten.
        steer: Road-wheel angle, in [rad].
        command: Road-wheel angle that the actuator goes to, in [rad].
        drive: Target speed, in [m/s], and acceleration, in [m/s^2], not finite if it is not given.
        dt: Step, in [s].
        substeps: Number of equal Runge-Kutta steps in it.
        p: The car, as `LinearPlant` lays it out.

    Returns:
        Road-wheel angle at the end, in [rad].
    """
    h = dt / substeps
    slope, total, trial = np.empty(6), np.empty(6), np.empty(6)
    for _ in range(substeps):
        middle = steered(steer, command, 0.5 * h, p[6], p[7])
        end = steered(steer, command, h, p[6], p[7])
        trial[:], total[:] = motion, 0.0
        for angle, reach, weight in ((steer, 0.5, 1.0), (middle, 0.5, 2.0), (middle, 1.0, 2.0), (end, 0.0, 1.0)):
            _slope(trial, angle, drive, p, slope)
            for i in range(6):
                total[i] += weight * slope[i]
                trial[i] = motion[i] + reach * h * slope[i]
        for i in range(6):
            motion[i] += h / 6.0 * total[i]
        steer = end
    return steer


@kernel
def _slope(motion, steer, drive, p, slope):
    yaw, v_x, v_y, yaw_rate = motion[2], motion[3], motion[4], motion[5]
    mass, inertia, l_f, l_r, stiffness_f, stiffness_r = p[0], p[1], p[2], p[3], p[4], p[5]
    slip_speed = max(abs(v_x), SLIP_SPEED)
    front = stiffness_f * (steer * v_x - v_y - l_f * yaw_rate) / slip_speed
    rear = stiffness_r * (l_r * yaw_rate - v_y) / slip_speed
    slope[0] = v_x * math.cos(yaw) - v_y * math.sin(yaw)
    slope[1] = v_x * math.sin(yaw) + v_y * math.cos(yaw)
    slope[2] = yaw_rate
    slope[3] = asked_acceleration(v_x, drive[0], drive[1], p[8], p[9])
    slope[4] = (front + rear) / mass - v_x * yaw_rate
    slope[5] = (l_f * front - l_r * rear) / inertia
