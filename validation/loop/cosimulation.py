"""The co-simulation loop: controller, bus and plant stepped in a fixed order.

Time runs in control periods T, each of n equal plant steps of at most 10 ms. Per control period, at t_k:

    get   the state x(t_k) that the last plant step returned
    step  the controller: u_k = controller.step(x(t_k))
    set   n times: send the command in force over the bus, take what arrives, plant.step(it, T / n)

The command in force over [t_k, t_k + T] is u_k with zero-delay coupling (the controller computes in no time,
as a sequential FMI master does it) and u_(k-1) with one-step-delay coupling (controller and plant compute side
by side); before the first one, the steering is held as it is at the start.
"""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, Protocol

import numpy as np

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.validation.loop.recording import SAMPLE_UNITS, STEP_UNITS, End, Recording
from sidestep.validation.loop.start import reset_to
from sidestep.validation.scenarios.scenario import Scenario

PLANT_STEP = 0.01
"""Longest plant step, and the period of the command frames on the bus, in [s]."""

STANDSTILL = 0.1
"""Speed below which a car that was commanded to stop counts as standing, in [m/s]."""

_S = list(SAMPLE_UNITS).index("s")

Coupling = Literal["zero-delay", "one-step-delay"]


class Controller(Protocol):
    """What the loop needs of a controller."""

    @property
    def plan(self) -> Any:
        """The plan behind the last command."""
        ...

    def reset(self) -> None:
        """Forget the past."""
        ...

    def step(self, state: VehicleState) -> SteeringCommand:
        """The command that answers `state`."""
        ...


class Port(Protocol):
    """What the loop needs of a bus."""

    def transmit(self, command: SteeringCommand) -> SteeringCommand | None:
        """Send the command; what the plant's side receives, None if nothing arrives."""
        ...


def cosimulate(
    controller: Controller,
    plant: Plant,
    scenario: Scenario,
    port: Port | None = None,
    coupling: Coupling = "zero-delay",
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """Drive `scenario` until its time is over, the road ends, the car has stopped, or something breaks.

    This is the one loop of the package. Nothing is raised once the car moves, a keyboard interrupt included: the
    recording says how the run ended.

    Args:
        controller: Is reset first.
        plant: Is reset to the scenario's start.
        scenario: Start, path, speed, duration and control period.
        port: Bus between controller and plant; None hands the commands over directly.
        coupling: Which command is in force, see above.
        progress: Called with the simulated time, in [s], before every control period.

    Raises:
        InputError: Unknown coupling, or the plant does not start where the scenario puts it, see `start`.
        PlantError: The plant cannot start.
    """
    if coupling not in ("zero-delay", "one-step-delay"):
        raise InputError("coupling", f"{coupling!r}", "zero-delay, one-step-delay")
    run = _Run(controller, plant, scenario, port, coupling == "one-step-delay")
    run.reset()
    began, error = time.perf_counter(), None
    try:
        end = run.drive(progress or (lambda _: None))
    except KeyboardInterrupt as interrupt:
        end, error = End.INTERRUPTED, interrupt
    except Exception as raised:  # whoever raised it: the run is over, its recording is kept
        end, error = run.at_work, raised
    return run.recording(end, error, time.perf_counter() - began)


class _Run:
    def __init__(self, controller: Controller, plant: Plant, scenario: Scenario, port: Port | None, delayed: bool):
        self.controller, self.plant, self.scenario, self.port, self.delayed = controller, plant, scenario, port, delayed
        self.at_work = End.PLANT_INVALID  # whose failure it is if something is raised now
        self.samples: list[tuple[float, ...]] = []
        self.steps: list[tuple[float, ...]] = []
        self.plans: list[Any] = []

    def reset(self) -> None:
        self.controller.reset()
        self.state, self.departures = reset_to(self.plant, self.scenario.start, self.scenario.plant)
        self.command = SteeringCommand(self.state.time, self.state.steer_angle, self.scenario.speed)
        self.received = self.command

    def drive(self, progress: Callable[[float], None]) -> End:
        period = self.scenario.controller.period
        substeps = max(1, math.ceil(period / PLANT_STEP - 1e-9))
        for _ in range(round(self.scenario.duration / period)):
            progress(self.state.time)
            answer = self.control()
            if not self.delayed:
                self.command = answer
            for _ in range(substeps):
                self.send()
                self.record()
                self.advance(period / substeps)
                if end := self.ended():
                    return end
            self.command = answer
        return End.COMPLETED

    def control(self) -> SteeringCommand:
        self.at_work = End.CONTROLLER_ERROR
        began = time.perf_counter_ns()
        command = self.controller.step(self.state)
        elapsed = (time.perf_counter_ns() - began) / 1000.0
        plan = self.controller.plan
        self.plans.append(plan)
        self.steps.append(
            (
                self.state.time, float(command.status), float(plan.feasible), float(plan.iterations),
                plan.primal_residual, plan.dual_residual, plan.slack_corridor, plan.slack_slip, plan.stop_distance,
                plan.solve_us, elapsed,
            )
        )  # fmt: skip
        return command

    def send(self) -> None:
        self.at_work = End.BUS_ERROR
        command = replace(self.command, time=self.state.time)
        self.received = (self.port.transmit(command) if self.port else command) or self.received

    def advance(self, dt: float) -> None:
        self.at_work = End.PLANT_INVALID
        self.state = _finite(self.plant.step(self.received, dt))

    def record(self) -> None:
        state, command, received = self.state, self.command, self.received
        s, l, heading = self.road_position()  # noqa: E741 (the paper's letter)
        self.samples.append(
            (
                state.time, state.x, state.y, state.yaw, state.v_x, state.v_y, state.yaw_rate, state.steer_angle,
                s, l, math.remainder(state.yaw - heading, math.tau),
                command.steer_angle, received.steer_angle, received.target_speed,
                received.acceleration, float(received.status),
            )
        )  # fmt: skip

    def road_position(self) -> tuple[float, float, float]:
        near = self.samples[-1][_S] if self.samples else None
        return self.scenario.path.project(self.state.x, self.state.y, near)

    def ended(self) -> End | None:
        path, (s, l, heading) = self.scenario.path, self.road_position()  # noqa: E741 (the paper's letter)
        if self.scenario.goal and self.scenario.goal.holds(self.state, s, l, self.state.yaw - heading):
            return End.GOAL
        if not path.closed and s >= path.length:
            return End.END_OF_ROAD
        if self.state.v_x < STANDSTILL and self.received.status in (Status.BLOCKED, Status.FAULT):
            return End.STOPPED
        return None

    def recording(self, end: End, error: BaseException | None, wall_time: float) -> Recording:
        """The columns, with what follows from neighbouring samples: a_y = v_y' + v_x gamma and the steering rate."""
        if not self.samples or self.state.time > self.samples[-1][0]:
            self.record()
        samples = dict(zip(SAMPLE_UNITS, np.array(self.samples, dtype=float).T, strict=False))
        samples["lateral_acceleration"] = _rate(samples, "v_y") + samples["v_x"] * samples["yaw_rate"]
        samples["steer_rate"] = _rate(samples, "steer_angle")
        steps = np.array(self.steps, dtype=float).reshape(-1, len(STEP_UNITS))
        columns = dict(zip(STEP_UNITS, steps.T, strict=True))
        contact = bool(getattr(self.plant, "collided", False))
        estimated = tuple(getattr(self.plant, "estimated", ()))
        plans, off = tuple(self.plans), self.departures
        return Recording(samples, columns, plans, end, error, wall_time, contact, estimated, off)


def _finite(state: VehicleState) -> VehicleState:
    if not state.is_finite():
        raise PlantError(f"the plant returned a state that is not finite: {state}")
    return state


def _rate(samples: dict[str, np.ndarray], name: str) -> np.ndarray:
    return np.gradient(samples[name], samples["time"]) if len(samples["time"]) > 1 else np.zeros_like(samples[name])
