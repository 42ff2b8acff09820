"""The stepping controller: state in, steering command out."""

import math
import pickle
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.decision.corridor import excess_over
from sidestep.controller.decision.corridor_planner import Corridor, NodeGrid, plan_corridor
from sidestep.controller.decision.planner import FREE, PlannedPath, PlannerSettings
from sidestep.controller.decision.stopping import SWERVE_TIME, approach_speed, spare_braking, squeezed_speed
from sidestep.controller.mpc.car_model import Car, peak_slip
from sidestep.controller.mpc.mpc import Mpc, Problem, Solution
from sidestep.controller.mpc.prediction import SLOWEST, Prediction, advance
from sidestep.controller.mpc.roll import Body, advance_roll, lateral_acceleration, roll_ahead
from sidestep.controller.paper import PaperMpc
from sidestep.controller.perception.observer import Disturbance, observe_disturbance, observe_friction
from sidestep.controller.plan import Plan
from sidestep.controller.validity import Validity
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.plant_models.speed_control import SPEED_GAIN
from sidestep.plant_models.vehicle.parameters import VehicleParameters

Array = NDArray[np.float64]

FEASIBLE_SLACK = 1e-3
"""Corridor slack up to which a step counts as feasible, in [m]."""
SHIFTED_PLAN_TIME = 0.2
"""How long the last good plan is followed when the QP fails, in [s]; longer than that is a FAULT."""
OBSERVED_SPEED = 3.0
"""Speed below which nothing is learned: sideslip is not defined well, in [m/s]."""
TRUSTED_SLIP = 0.05
"""Excess over the slip bound, in [rad], from which on a prediction is nothing to take tangents at: they would only
lead deeper into it."""
_MEMORY = ("plan", "_good", "_command", "_heard", "_sent", "_station", "_cruise", "_sides", "_held_up", "_before",
           "_disturbance", "_roll")  # fmt: skip
STANDSTILL = 0.1
"""Speed below which the wheels are not turned, in [m/s]."""


class SteeringController:
    """Corridor planner and MPC behind `reset` and `step`.

    Deterministic: the same states give the same commands, bit for bit. Nothing raises in `step`:
    what goes wrong shows in the command's status and in `plan`.
    """

    def __init__(self, vehicle: VehicleParameters, path: ReferencePath, obstacles: Sequence[Obstacle] = (),
                 config: ControllerConfig | None = None):  # fmt: skip
        self.vehicle, self.path, self.config = vehicle, path, config or ControllerConfig()
        self.obstacles = tuple(obstacles)
        self._boxes = np.array(
            [(o.s, o.l, o.length, o.width, o.heading, o.speed) for o in self.obstacles], dtype=np.float64
        ).reshape(-1, 6)
        c = self.config
        self._body = Body.of(vehicle) if c.body_roll else None
        self._validity = Validity.of(c)
        self._mpc: Mpc | PaperMpc
        if c.formulation == "paper":
            valid = self._validity.by_speed(c.friction).min() if self._validity else math.inf
            self._mpc = PaperMpc(vehicle, c.weight_steer, min(c.max_lateral_acceleration, float(valid)))
        else:
            self._mpc = Mpc.of(vehicle, c)
        self._settings = PlannerSettings.of(vehicle, c)
        self._grid = NodeGrid.of(vehicle, c, self._mpc.times)
        self._node_times = np.concatenate([[0.0], self._mpc.times])
        self._horizon = float(self._node_times[-1])
        self._swerve_nodes = int(np.searchsorted(self._node_times, SWERVE_TIME))
        self._load_kernels()

    def _load_kernels(self) -> None:
        """Compiled code is loaded at its first call: here, off the road, where all bounds act, not on the way."""
        self.reset()
        x, y = self.path.to_cartesian(0.0, self.config.width_left)
        yaw = self.path.heading(0.0) + 0.3
        for k in range(2):  # only the second has something to learn from
            SteeringController.step(self, VehicleState(k * self.config.period, x, y, yaw, v_x=10.0))
        self.reset()

    def reset(self) -> None:
        """Forget everything that was kept from earlier steps."""
        self.plan: Plan | None = None
        self._good: Plan | None = None
        self._command: SteeringCommand | None = None
        self._heard: float | None = None  # time of the last state that could be used
        self._sent: list[float] = []  # the angle in force, then those on their way
        self._station: float | None = None
        self._cruise = self.config.cruise_speed
        self._sides = np.zeros(len(self.obstacles), dtype=np.int64)
        self._held_up = False
        self._before: tuple[float, Array] | None = None  # time and state of the last step
        self._disturbance = Disturbance()
        self._roll = 0.0, 0.0
        self._believe(self.config.friction)
        self._mpc.reset()

    def save(self) -> bytes:
        """All that is kept from step to step, for `restore`."""
        moves = self._mpc.moves if isinstance(self._mpc, Mpc) else None
        return pickle.dumps(([getattr(self, name) for name in _MEMORY], self._car.friction, moves))

    def restore(self, memory: bytes) -> None:
        """Go on from where `save` was called, bit for bit.

        Args:
            memory: From a controller of the same car, road and period; other settings may differ, and
                hold from now on. Only your own: it is a pickle.
        """
        values, friction, moves = pickle.loads(memory)
        for name, value in zip(_MEMORY, values, strict=True):
            setattr(self, name, value)
        if self.config.cruise_speed is not None:
            self._cruise = self.config.cruise_speed
        if not self.config.reject_disturbance:
            self._disturbance = Disturbance()
        if self._sent:
            kept = self.config.input_delay_steps + 1
            self._sent = (self._sent[:1] * kept + self._sent)[-kept:]
        self._believe(friction if self.config.estimate_friction else self.config.friction)
        if isinstance(self._mpc, Mpc):
            self._mpc.moves = moves

    def _believe(self, friction: float) -> None:
        self._car = Car.of(self.vehicle, self.config.tyre_model == "affine", friction, self._body)
        share = self.config.slip_share
        self._slip_limits = (
            share * peak_slip(self._car.stiffness_f, self._car.load_f, self._car),
            share * peak_slip(self._car.stiffness_r, self._car.load_r, self._car),
        )

    def _slip_bounds(self, v: float) -> tuple[float, float]:
        """The slip limits, at this speed [m/s] within what the prediction is valid for."""
        front, rear = self._slip_limits
        if self._validity is None:
            return front, rear
        slip = self._validity.slip_at(v, self._car)
        return min(front, slip[0]), min(rear, slip[1])

    @property
    def problem(self) -> Problem | None:
        """QP of the last solve, for solver comparisons; the next step overwrites its arrays."""
        return self._mpc.problem

    def step(self, state: VehicleState) -> SteeringCommand:
        """Plan, predict, optimise.

        Args:
            state: Newest state; times must grow from call to call.

        Returns:
            The command to hold until the next step. A state that is not finite or not newer than the
            last one is answered from the last good plan and never reaches the solver.
        """
        began = time.perf_counter()
        if state.is_finite() and (self._heard is None or state.time > self._heard):
            self._heard = state.time
            plan = self._track(state, began)
        else:
            plan = self._fall_back(self._command.time + self.config.period if self._command else 0.0, "INPUT")
        self.plan = plan
        limit = self.vehicle.steer_limit
        angle = min(max(float(plan.states[1, 5]) - self._disturbance.angle, -limit), limit)
        self._command = SteeringCommand(plan.time, angle, plan.target_speed, plan.status)
        if self._sent:
            self._sent = [*self._sent[1:], angle]
        return self._command

    def _track(self, state: VehicleState, began: float) -> Plan:
        v = state.v_x
        if self._cruise is None:
            self._cruise = max(v, 0.0)
        s, x0, roll = self._locate(state)
        good = self._good
        if good and good.slack_slip < TRUSTED_SLIP:
            before = Prediction(good.states_time, good.states, good.roll, state.time - good.time)
        else:
            before = Prediction.lasting(x0)
        corridor = self._plan_corridor(s, x0[0], state, before)
        planned = time.perf_counter()
        solution = self._solve(x0, corridor, v, before)
        target, stop_distance = self._longitudinal(corridor, solution, v)
        sides = corridor.path.sides
        self._held_up = corridor.path.blocker != FREE
        self._sides = np.where(sides == 0, self._sides, sides) if self._held_up else sides
        if v < STANDSTILL:
            solution.states[1:, 5] = x0[5]
        plan = self._plan(state, s, roll, corridor, solution, stop_distance, target, began, planned)
        if not solution.solved or not math.isfinite(solution.states.sum()):
            return self._fall_back(state.time, solution.status, plan)
        self._good = plan
        return plan

    def _locate(self, state: VehicleState) -> tuple[float, Array, tuple[float, float]]:
        """Station, prediction state and roll at the time when the next command takes effect."""
        v, config = state.v_x, self.config
        s, l, heading = self.path.project(state.x, state.y, self._station)  # noqa: E741
        self._station = s
        if not self._sent:
            self._sent = [state.steer_angle] * (config.input_delay_steps + 1)
        x = np.array([
            l, math.remainder(state.yaw - heading, math.tau), state.v_y / max(v, 1.0), state.yaw_rate,
            state.steer_angle, self._sent[0],
        ])  # fmt: skip
        self._observe(state, x)
        limit, angle = self.vehicle.steer_limit, self._disturbance.angle
        x[4] += self._disturbance.sensor
        x[5] = min(max(x[5] + angle, -limit), limit)
        if len(self._sent) == 1:  # nothing is on its way
            return s, x, self._roll
        pending = np.clip(np.array(self._sent[1:]) + angle, -limit, limit)
        s += v * config.period * len(pending)
        turn_rate = v * self.path.curvature(s)
        forces = self._disturbance.forces(self._car)
        x, roll = advance(x, self._roll, v, turn_rate, forces, pending, config.period, self._car)
        return s, x, roll

    def _observe(self, state: VehicleState, x: Array) -> None:
        """Learn from how the last step really went."""
        before, self._before = self._before, (state.time, x.copy())
        rolled, self._roll = self._roll, (0.0, 0.0)
        config = self.config
        if before is None or state.v_x < OBSERVED_SPEED:
            return
        passed = state.time - before[0]
        if not 0.5 * config.period < passed < 1.5 * config.period:
            return
        start = before[1].copy()
        start[5] = self._sent[0]  # what was in force since
        if self._body:
            lateral = lateral_acceleration(start, x, state.v_x, passed)
            self._roll = advance_roll(*rolled, lateral, passed, self._body)
        step = self._roll, state.v_x, passed, self._car, self._slip_limits
        if config.reject_disturbance:
            self._disturbance = Disturbance(*observe_disturbance(self._disturbance, start, x, *step))
        if config.estimate_friction:
            self._believe(observe_friction(start, x, self._disturbance.sensor, *step, config.friction))

    def _solve(self, x0: Array, corridor: Corridor, v: float, before: Prediction) -> Solution:
        mpc = self._mpc
        if isinstance(mpc, PaperMpc):
            return mpc.solve(x0, v, corridor.turn_rate, corridor.bounds, self.config.reference_offset)
        return mpc.solve(
            x0, v, corridor.offset, corridor.slope, corridor.firmness, corridor.turn_rate, corridor.bounds, before,
            self._disturbance.forces(self._car), self._slip_bounds(v), self._car,
        )  # fmt: skip

    def _plan_corridor(self, s: float, l: float, state: VehicleState, before: Prediction) -> Corridor:  # noqa: E741
        path, stations, offset, slope, firmness, turn_rate, bounds, heeded, gap, gap_speed = plan_corridor(
            s, l, state.v_x, self._cruise or 0.0, state.time, self._boxes, self.path.table, self.path.period,
            self._sides, self._held_up, self.plan is None or self.plan.feasible, self._settings, self._grid,
            before.times, before.states, before.age,
        )  # fmt: skip
        path = PlannedPath(*path)
        return Corridor(path, stations, offset, slope, firmness, turn_rate, bounds, heeded, gap, gap_speed)

    def _longitudinal(self, corridor: Corridor, solution: Solution, v: float) -> tuple[float, float]:
        """Speed to hold, and free distance before what blocks the road."""
        config, target, distance = self.config, self._cruise or 0.0, math.inf
        blocked = corridor.path.blocker != FREE
        if blocked:
            distance = corridor.gap - config.standstill_gap
            target = min(target, approach_speed(distance, corridor.gap_speed, config.comfort_braking))
        if solution.slack_corridor > config.tightening:
            worst, first = excess_over(corridor.heeded, solution.states, self._node_times, self._grid.levers)
            room = v * min(first, self._horizon) - self.vehicle.front_extent
            target = min(target, squeezed_speed(worst - config.tightening, room, blocked, config))
        if self._command:  # slowing that comes and goes from step to step would only waste grip
            target = min(target, max(self._command.target_speed, v) + config.comfort_braking * config.period)
        swerve = v * float(np.abs(solution.states[: self._swerve_nodes, 3]).max())
        return max(target, v - spare_braking(swerve, self._car.friction) / SPEED_GAIN), max(distance, 0.0)

    def _plan(self, state: VehicleState, s: float, roll: tuple[float, float], corridor: Corridor, solution: Solution,
              stop_distance: float, target: float, began: float, planned: float) -> Plan:  # fmt: skip
        path = corridor.path
        feasible = solution.solved and solution.slack_corridor <= FEASIBLE_SLACK
        status = Status.TRACKING if feasible and solution.slack_slip <= FEASIBLE_SLACK else Status.DEGRADED
        return Plan(
            time=state.time, status=Status.BLOCKED if path.blocker != FREE else status,
            s=s + path.stations, l=path.offsets, left=path.left, right=path.right,
            states=solution.states, roll=self._roll_ahead(roll, solution.states, state.v_x),
            states_s=s + np.concatenate([[0.0], corridor.stations]), states_time=self._node_times,
            solver_status=solution.status, iterations=solution.iterations,
            primal_residual=solution.primal_residual, dual_residual=solution.dual_residual,
            slack_corridor=solution.slack_corridor, slack_slip=solution.slack_slip, feasible=feasible,
            plan_us=1e6 * (planned - began), build_us=solution.build_us, solve_us=solution.solve_us,
            step_us=1e6 * (time.perf_counter() - began),
            stop_distance=stop_distance, target_speed=target, sides=tuple(path.sides.tolist()),
        )  # fmt: skip

    def _roll_ahead(self, roll: tuple[float, float], states: Array, v: float) -> Array:
        if self._body is None:
            return np.zeros((len(states), 2))
        return roll_ahead(*roll, self._node_times, states, max(v, SLOWEST), self._body)

    def _fall_back(self, now: float, solver_status: str, failed: Plan | None = None) -> Plan:
        """The last good plan shifted to now; when that is too old, hold the angle and slow down."""
        good, last = self._good, self._command
        age = now - good.time if good else math.inf
        base = failed or good or Plan.empty(self._node_times)
        held = last.steer_angle if last else 0.0
        if good is not None and age <= SHIFTED_PLAN_TIME + 1e-9:
            later = good.states_time + age
            states = np.column_stack([np.interp(later, good.states_time, column) for column in good.states.T])
            status, target = Status.DEGRADED, min(base.target_speed, good.target_speed)
        else:
            states = base.states.copy()
            states[:, 4:] = held + self._disturbance.angle
            slower = (last.target_speed if last else 0.0) - self.config.comfort_braking * self.config.period
            status, target = Status.FAULT, max(slower, 0.0)
        return base._replace(
            time=now, status=status, states=states, solver_status=solver_status, feasible=False,
            target_speed=target,
        )  # fmt: skip
