"""The stepping controller: state in, steering command out."""

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.memory import empty, restored, saved
from sidestep.controller.mpc.piqp_solver import PiqpSolver, Problem
from sidestep.controller.mpc.status import UNCONSTRAINED
from sidestep.controller.paper import PaperMpc
from sidestep.controller.plan import Plan
from sidestep.controller.records import STATE, WORK, record
from sidestep.controller.settings import settings_of
from sidestep.controller.step import BOUNDED, begin, finish, step
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

_STATUS = tuple(Status)


class SteeringController:
    """Corridor planner and MPC behind `reset` and `step`.

    Deterministic: the same states give the same commands, bit for bit. Nothing raises in `step`:
    what goes wrong shows in the command's status and in `plan`.
    """

    def __init__(self, vehicle: VehicleParameters, path: ReferencePath, obstacles: Sequence[Obstacle] = (),
                 config: ControllerConfig | None = None):  # fmt: skip
        self.vehicle, self.path, self.config = vehicle, path, config or ControllerConfig()
        self.obstacles = tuple(obstacles)
        self.boxes = np.array(
            [(o.s, o.l, o.length, o.width, o.heading, o.speed) for o in self.obstacles], dtype=np.float64
        ).reshape(-1, 6)
        self.settings = settings_of(vehicle, self.config)
        self.work, self._state = record(WORK), record(STATE)
        self._signals = self._state.view(np.float64)
        grid = self.settings["grid"][0]
        self._solver: PiqpSolver | PaperMpc
        if self.config.formulation == "paper":
            self._solver = PaperMpc(vehicle, self.config)
        else:
            moves, nodes = int(grid["moves"]), int(grid["nodes"])
            count = 2 * (nodes - int(grid["first"])) + 2 * int(grid["slips"]) + moves
            self._solver = PiqpSolver(moves, count, vehicle.steer_rate_limit)
        self._first = step if self.config.solver == "active-set" and not grid["literal"] else begin
        self._load_kernels()

    def _load_kernels(self) -> None:
        """Compiled code is loaded at its first call: here, off the road, where all bounds act, not on the way."""
        self.reset()
        x, y = self.path.to_cartesian(0.0, self.config.width_left)
        self.path.project(x, y, 0.0)  # whoever drives beside the controller asks for this, too
        yaw = self.path.heading(0.0) + 0.3
        for k in range(2):  # only the second has something to learn from
            SteeringController.step(self, VehicleState(k * self.config.period, x, y, yaw, v_x=10.0))
        self.reset()

    def reset(self) -> None:
        """Forget everything that was kept from earlier steps."""
        self._memory = empty(float(self.settings["cruise"][0]))
        self._times = 0.0, 0.0

    def save(self) -> bytes:
        """All that is kept from step to step, for `restore`."""
        return saved(self._memory)

    def restore(self, memory: bytes) -> None:
        """Go on from where `save` was called, bit for bit.

        Args:
            memory: From a controller of the same car, road and period; other settings may differ, and hold from now
                on.

        Raises:
            InputError: The bytes are not a memory of this version, or damaged.
        """
        self._memory = restored(memory)
        m, c = self._memory[0], self.config
        if c.cruise_speed is not None:
            m["cruise"] = c.cruise_speed
        if not c.reject_disturbance:
            m["disturbance"] = np.zeros((), m["disturbance"].dtype)
        if m["on_the_way"]:
            kept, sent = c.input_delay_steps + 1, m["sent"][: m["on_the_way"]].tolist()
            m["sent"][:kept], m["on_the_way"] = (sent[:1] * kept + sent)[-kept:], kept

    @property
    def problem(self) -> Problem | None:
        """QP of the last step, for solver comparisons; the next one overwrites its arrays."""
        if isinstance(self._solver, PiqpSolver) and self.work["solver_status"][0] == UNCONSTRAINED:
            return self._solver.choose_rows(self.work, self._last_moves())
        return self._solver.problem

    @property
    def plan(self) -> Plan | None:
        """What was behind the last command; None before the first step."""
        m = self._memory[0]
        return (
            Plan.of(m["plans"][m["last"]], self.settings[0], len(self.obstacles), *self._times)
            if m["last"] >= 0
            else None
        )

    def step(self, state: VehicleState) -> SteeringCommand:
        """Plan, predict, optimise.

        Args:
            state: Newest state; times must grow from call to call.

        Returns:
            The command to hold until the next step. A state that is not finite or not newer than the
            last one is answered from the last good plan and never reaches the solver.
        """
        began = time.perf_counter()
        self._signals[:] = (
            state.time, state.x, state.y, state.yaw, state.v_x, state.v_y, state.yaw_rate, state.steer_angle,
        )  # fmt: skip
        road = self.path.table, self.path.period
        taken = self._first(self._memory, self.settings, *road, self.boxes, self._state, self.work)
        asked = answered = time.perf_counter()
        if taken == BOUNDED:
            solved = self._solver.solve(self.work, self._last_moves())
            answered = time.perf_counter()
            finish(self._memory, self.settings, self._state, self.work, solved)
        self._times = 1e6 * (answered - asked), 1e6 * (time.perf_counter() - began)
        return self.command

    @property
    def command(self) -> SteeringCommand:
        """The last command; a FAULT at standstill before the first step."""
        at, angle, acceleration, target, status = self._memory["command"][0].item()
        return SteeringCommand(at, angle, target, _STATUS[status], acceleration=acceleration)

    def _last_moves(self) -> NDArray[np.float64]:
        return self._memory["moves"][0, : int(self.settings["grid"]["moves"][0])]
