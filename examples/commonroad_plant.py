"""CommonRoad's multi-body car (29 states, PyPI commonroad-vehicle-models) as a plant for every subcommand.

    pip install commonroad-vehicle-models
    sidestep run moose --plant examples.commonroad_plant:CommonRoadCar --set speed=12
    sidestep validate --plant examples.commonroad_plant:CommonRoadCar --quick

Plain Python, slower than real time. Its parameter sets 1 to 3 are the presets ford-escort, bmw-320i and vw-vanagon.
"""

from math import atan2, ceil, cos, isfinite, sin
from types import SimpleNamespace
from typing import Any, Self

import numpy as np

from sidestep.plant_models import InputError, PlantError, SteeringCommand, VehicleParameters, VehicleState
from sidestep.plant_models.linear.plant import steered
from sidestep.plant_models.speed_control import limited_acceleration

SETS = {"ford-escort": 1, "bmw-320i": 2, "vw-vanagon": 3}
STEP = 2e-3
"""Longest Runge-Kutta step, in [s]: the joints of its axles are stiff."""
STEER, V_X, YAW, YAW_RATE, V_Y, V_FRONT, V_REAR, WHEELS = 2, 3, 4, 5, 10, 15, 20, slice(23, 27)


class CommonRoadCar:
    """The multi-body model, with the steering actuator and the speed control of the vehicle file; a `Plant`."""

    def __init__(self, vehicle: VehicleParameters):
        from vehiclemodels.init_mb import init_mb  # pyright: ignore[reportMissingImports]
        from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb  # pyright: ignore[reportMissingImports]

        if vehicle.name not in SETS:
            raise InputError("vehicle.preset", f"{vehicle.name!r} is no CommonRoad set", ", ".join(SETS))
        self.vehicle, self._rates, self._initial = vehicle, vehicle_dynamics_mb, init_mb
        self._set = _parameters(SETS[vehicle.name])

    def reset(self, state: VehicleState) -> VehicleState:
        """Start from `state`, the body upright, the wheels rolling."""
        if not state.is_finite():
            raise PlantError(f"cannot start from a state that is not finite: {state}")
        limit = self.vehicle.steer_limit
        speed = (state.v_x**2 + state.v_y**2) ** 0.5
        beta = atan2(state.v_y, state.v_x) if speed else 0.0
        steer = min(max(state.steer_angle, -limit), limit)
        core = [state.x, state.y, steer, speed, state.yaw, state.yaw_rate, beta]
        self._x = np.array(self._initial(core, self._set), dtype=float)
        self._time, self._command = state.time, SteeringCommand(state.time, steer, state.v_x)
        return self._seen()

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds."""
        if not 0.0 < dt < float("inf"):
            raise InputError("dt", f"{dt} s", "> 0")
        if isfinite(command.steer_angle + command.target_speed):
            self._command = command
        count = ceil(dt / STEP - 1e-9)
        for _ in range(count):
            self._advance(dt / count)
        self._time += dt
        seen = self._seen()
        if not seen.is_finite():
            raise PlantError(f"the multi-body model diverges after {self._time:.3f} s")
        return seen

    def _advance(self, h: float) -> None:
        """Runge-Kutta 4 with the steering rate of the actuator, exact at the end of the step."""
        car, x = self.vehicle, self._x
        limit = car.steer_limit
        wanted = min(max(self._command.steer_angle, -limit), limit)
        angle = steered(x[STEER], wanted, h, car.steer_time_constant, car.steer_rate_limit)
        push = limited_acceleration(x[V_X], self._command.target_speed, car.max_braking, car.max_acceleration)
        inputs = [(angle - x[STEER]) / h, push]
        k1 = self._slope(x, inputs)
        k2 = self._slope(x + 0.5 * h * k1, inputs)
        k3 = self._slope(x + 0.5 * h * k2, inputs)
        k4 = self._slope(x + h * k3, inputs)
        self._x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        self._x[STEER] = angle
        self._x[WHEELS] = np.maximum(self._x[WHEELS], 0.0)

    def _slope(self, x: np.ndarray, inputs: list[float]) -> np.ndarray:
        """Its own rates; the position moves with the total centre of gravity, not with the body's."""
        slope = np.array(self._rates(x.tolist(), list(inputs), self._set), dtype=float)
        v_y = self._lateral_speed(x)
        slope[0] = x[V_X] * cos(x[YAW]) - v_y * sin(x[YAW])
        slope[1] = x[V_X] * sin(x[YAW]) + v_y * cos(x[YAW])
        return slope

    def _lateral_speed(self, x: np.ndarray) -> float:
        """Of the total centre of gravity: body and both axles, each moves sideways on its own."""
        p, r = self._set, x[YAW_RATE]
        axles = p.m_uf * (x[V_FRONT] - p.a * r) + p.m_ur * (x[V_REAR] + p.b * r)
        return float((p.m_s * x[V_Y] + axles) / p.m)

    def _seen(self) -> VehicleState:
        x = [float(value) for value in self._x]
        return VehicleState(self._time, x[0], x[1], x[YAW], x[V_X], self._lateral_speed(self._x), x[YAW_RATE], x[STEER])

    def close(self) -> None:
        """Nothing is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _parameters(number: int) -> Any:
    """A parameter set as a plain namespace: OmegaConf's takes longer to read than the model to compute."""
    from omegaconf import OmegaConf  # pyright: ignore[reportMissingImports]
    from vehiclemodels.vehicle_parameters import setup_vehicle_parameters  # pyright: ignore[reportMissingImports]

    def plain(value: Any) -> Any:
        return SimpleNamespace(**{k: plain(v) for k, v in value.items()}) if isinstance(value, dict) else value

    return plain(OmegaConf.to_container(OmegaConf.structured(setup_vehicle_parameters(vehicle_id=number))))
