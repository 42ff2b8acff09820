"""Stand-ins for the tests of the loop: a controller and plants that note what they are asked, and when."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from sidestep.controller import Plan
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.validation.scenarios.scenario import Scenario


def straight_plan(state: VehicleState) -> Plan:
    """A plan with a corridor of 3 m on both sides and a car that stays where it is across the road."""
    s = state.x + np.linspace(0.0, 40.0, 21)
    across = np.full(21, state.y)
    states = np.tile([state.y, state.yaw, 0.0, state.yaw_rate, 0.0, 0.0], (5, 1))
    return Plan(
        time=state.time, status=Status.TRACKING, s=s, l=across, left=np.full(21, 3.0), right=np.full(21, -3.0),
        states=states, roll=np.zeros((5, 2)), states_s=s[:5], states_time=np.array([0.0, 0.1, 0.2, 0.3, 0.4]),
        solver_status="SOLVED", iterations=3, primal_residual=0.0, dual_residual=0.0, slack_corridor=0.0,
        slack_slip=0.0, feasible=True, solve_us=1.0, step_us=3.0,
    )  # fmt: skip


@dataclass
class Feedback:
    """Steers towards l_s = aim on a straight road; every command has an angle of its own."""

    aim: float = 0.0
    speed: float = 15.0
    status: Status = Status.TRACKING
    fails_at: float = math.inf
    log: list[str] = field(default_factory=list)
    plan: Plan | None = None

    def reset(self) -> None:
        self.log.append("controller.reset")

    def step(self, state: VehicleState) -> SteeringCommand:
        self.log.append(f"controller.step {state.time:.2f}")
        if state.time >= self.fails_at:
            raise ArithmeticError("the plan fell through")
        self.plan = straight_plan(state)
        steer = 0.01 * (self.aim - state.y) - 0.2 * state.yaw
        return SteeringCommand(state.time, steer, self.speed, self.status)


@dataclass
class KinematicCar:
    """A plant that goes where its wheels point, on the axles' middle; takes over the target speed at once."""

    raises: BaseException | None = None
    raises_at: float = math.inf
    log: list[str] = field(default_factory=list)
    applied: list[SteeringCommand] = field(default_factory=list)
    state: VehicleState = field(default_factory=VehicleState)

    def reset(self, state: VehicleState) -> VehicleState:
        self.log.append("plant.reset")
        self.state = state
        return state

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        self.log.append(f"plant.step {self.state.time:.2f}")
        self.applied.append(command)
        now = self.state
        if self.raises is not None and now.time >= self.raises_at - 1e-9:
            raise self.raises
        yaw_rate = command.target_speed * math.tan(command.steer_angle) / 2.6
        self.state = replace(
            now, time=now.time + dt, x=now.x + command.target_speed * math.cos(now.yaw) * dt,
            y=now.y + command.target_speed * math.sin(now.yaw) * dt, yaw=now.yaw + yaw_rate * dt,
            v_x=command.target_speed, yaw_rate=yaw_rate, steer_angle=command.steer_angle,
        )  # fmt: skip
        return self.state

    def close(self) -> None:
        self.log.append("plant.close")

    def __enter__(self) -> "KinematicCar":
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def shortened(scenario: Scenario, duration: float) -> Scenario:
    """The same scenario for less time."""
    return replace(scenario, duration=duration)
