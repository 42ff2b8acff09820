"""A plant of your own for every subcommand: a car whose tyres give way, given by its name.

    sidestep run moose --plant examples.plant_by_name:sliding_car
    sidestep validate --plant examples.plant_by_name:sliding_car --quick
    sidestep identify --plant examples.plant_by_name:sliding_car --out mine.toml
    sidestep can plant single-obstacle --plant examples.plant_by_name:sliding_car

The module is found from the working directory, or is installed. A package can give its plant a name of its own:

    [project.entry-points."sidestep.plants"]
    sliding-car = "examples.plant_by_name:sliding_car"
"""

from math import ceil, cos, inf, isfinite, sin, tanh
from typing import Self

from sidestep.plant_models import InputError, PlantError, SteeringCommand, VehicleParameters, VehicleState
from sidestep.plant_models.linear.plant import steered
from sidestep.plant_models.speed_control import limited_acceleration

STEP, SLOWEST, GRAVITY = 1e-3, 1.0, 9.81
"""Longest step [s]; speed below which slip is that of this speed [m/s]; [m/s^2]."""


class SlidingCar:
    """Single track on tyres F = mu F_z tanh(C alpha / (mu F_z)); a `Plant`."""

    def __init__(self, vehicle: VehicleParameters, friction: float):
        self.vehicle, self.friction = vehicle, friction
        self._state: VehicleState | None = None

    def reset(self, state: VehicleState) -> VehicleState:
        """Start from `state`, its steering angle cut to the limit."""
        if not state.is_finite():
            raise PlantError(f"cannot start from a state that is not finite: {state}")
        limit = self.vehicle.steer_limit
        steer = min(max(state.steer_angle, -limit), limit)
        self._state = VehicleState(
            state.time, state.x, state.y, state.yaw, state.v_x, state.v_y, state.yaw_rate, steer
        )  # fmt: skip
        self._wanted, self._speed = steer, state.v_x
        return self._state

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds; one that is not finite is ignored."""
        if self._state is None:
            raise PlantError("step before reset")
        if not 0.0 < dt < inf:
            raise InputError("dt", f"{dt} s", "> 0")
        limit = self.vehicle.steer_limit
        if isfinite(command.steer_angle):
            self._wanted = min(max(command.steer_angle, -limit), limit)
        if isfinite(command.target_speed):
            self._speed = command.target_speed
        count = ceil(dt / STEP - 1e-9)
        for _ in range(count):
            self._state = self._moved(self._state, dt / count)
        return self._state

    def _moved(self, now: VehicleState, h: float) -> VehicleState:
        """Semi-implicit Euler: velocities first, the pose with the new ones."""
        car = self.vehicle
        steer = steered(now.steer_angle, self._wanted, h, car.steer_time_constant, car.steer_rate_limit)
        along = max(abs(now.v_x), SLOWEST)
        slip_f = steer - (now.v_y + car.l_f * now.yaw_rate) / along
        slip_r = -(now.v_y - car.l_r * now.yaw_rate) / along
        front = self._force(slip_f, car.cornering_stiffness_front, car.axle_load("front"))
        rear = self._force(slip_r, car.cornering_stiffness_rear, car.axle_load("rear"))
        v_x = now.v_x + h * limited_acceleration(now.v_x, self._speed, car.max_braking, car.max_acceleration)
        v_y = now.v_y + h * ((front + rear) / car.mass - now.v_x * now.yaw_rate)
        yaw_rate = now.yaw_rate + h * (car.l_f * front - car.l_r * rear) / car.yaw_inertia
        middle = now.yaw + 0.5 * h * yaw_rate
        x = now.x + h * (v_x * cos(middle) - v_y * sin(middle))
        y = now.y + h * (v_x * sin(middle) + v_y * cos(middle))
        return VehicleState(now.time + h, x, y, now.yaw + h * yaw_rate, v_x, v_y, yaw_rate, steer)

    def _force(self, slip: float, stiffness: float, load: float) -> float:
        most = self.friction * load
        return most * tanh(stiffness * slip / most)

    def close(self) -> None:
        """Nothing is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def sliding_car(vehicle: VehicleParameters, friction: float) -> SlidingCar:
    """What `--plant` names: it takes what it needs of vehicle, path, obstacles and friction."""
    return SlidingCar(vehicle, friction)
