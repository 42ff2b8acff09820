"""The controller on a plant of your own: here a kinematic bicycle whose wheels follow their command with a lag.

Three things to do: write `reset` and `step`, let `check_plant` look for slips in signs, units and reference point,
and step the two against each other. Run it: python examples/own_plant.py
"""

from math import cos, exp, isfinite, sin, tan
from typing import Self

from sidestep.controller import SteeringController
from sidestep.plant_models import (
    Line,
    Obstacle,
    ReferencePath,
    SteeringCommand,
    VehicleParameters,
    VehicleState,
    check_plant,
)


class KinematicCar:
    """Rolls without slip, as cars do at walking pace; a `Plant`."""

    def __init__(self, vehicle: VehicleParameters):
        self.vehicle = vehicle
        self.reset(VehicleState())

    def reset(self, state: VehicleState) -> VehicleState:
        """Start from `state`."""
        self.state, self.command = state, SteeringCommand(state.time, state.steer_angle, state.v_x)
        return state

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds, in pieces of 1 ms."""
        if isfinite(command.steer_angle + command.target_speed):
            self.command = command
        pieces = round(dt / 1e-3)
        for _ in range(pieces):
            self.state = self._moved(dt / pieces)
        return self.state

    def _moved(self, dt: float) -> VehicleState:
        car, now, wanted = self.vehicle, self.state, self.command
        angle = min(max(wanted.steer_angle, -car.steer_limit), car.steer_limit)
        turn = (angle - now.steer_angle) * (1.0 - exp(-dt / car.steer_time_constant))
        steer = now.steer_angle + min(max(turn, -car.steer_rate_limit * dt), car.steer_rate_limit * dt)
        faster = min(max(2.0 * (wanted.target_speed - now.v_x), -car.max_braking), car.max_acceleration)
        v_x = now.v_x + faster * dt
        yaw_rate = v_x * tan(steer) / car.wheelbase
        v_y, yaw = car.l_r * yaw_rate, now.yaw + yaw_rate * dt
        middle = 0.5 * (now.yaw + yaw)
        x = now.x + (v_x * cos(middle) - v_y * sin(middle)) * dt
        y = now.y + (v_x * sin(middle) + v_y * cos(middle)) * dt
        return VehicleState(now.time + dt, x, y, yaw, v_x, v_y, yaw_rate, steer)

    def close(self) -> None:
        """Nothing is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def main() -> None:
    car = VehicleParameters.preset("bmw-320i")
    for finding in check_plant(KinematicCar(car), car):
        print("check_plant:", finding)  # three: a car that rolls without slip is no BMW in a fast bend

    road = ReferencePath.from_segments([Line(150.0)])
    controller = SteeringController(car, road, [Obstacle(s=40.0, l=0.0, length=4.5, width=1.8)])
    with KinematicCar(car) as plant:
        state = plant.reset(VehicleState(v_x=5.0))
        for step in range(1200):
            command = controller.step(state)
            state = plant.step(command, dt=0.02)
            if step % 100 == 99:
                print(f"{state.time:4.1f} s: {state.x:5.1f} m along, {state.y:+.2f} m left, {command.status.name}")


if __name__ == "__main__":
    main()
