"""What the controller thought in its last step."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.mpc.status import NAMES
from sidestep.plant_models.notebook import facts_table
from sidestep.plant_models.signals import Status

Array = NDArray[np.float64]


class Plan(NamedTuple):
    """Planned path, corridor, prediction and solver figures of one step.

    Attributes:
        time: Of the state that it answers, in [s].
        status: As sent with the command.
        s: Stations of the planner's path along the road, shape (S,), in [m].
        l: Planned lateral offset, shape (S,), in [m].
        left, right: Corridor (13) for the car's centre at `s`, shape (S,), in [m].
        states: Predicted [l_s, e_phi, beta, gamma, delta, delta_c], shape (N + 1, 6).
        roll: Predicted roll angle and rate, shape (N + 1, 2), in [rad] and [rad/s]; zeros without `body_roll`.
        states_s: Stations of `states`, shape (N + 1,), in [m].
        states_time: Times of `states` from now, shape (N + 1,), in [s].
        solver_status: In the solver's words; "UNCONSTRAINED" if no bound acts, so that it was not needed, "INPUT" if
            the input kept it from being asked.
        iterations, primal_residual, dual_residual: Of the solver.
        slack_corridor: How far the prediction leaves the corridor, in [m].
        slack_slip: How far it leaves the slip bound, in [rad].
        feasible: Solved, and the corridor kept within 1 mm.
        solve_us, step_us: Time for the solver and for the whole step, in [us].
        stop_distance: Free distance before what blocks the road, in [m]; infinite if nothing does.
        target_speed: As sent with the command, in [m/s].
        acceleration: As sent with the command, in [m/s^2].
        sides: Passing side of each obstacle, +1 on its left, -1 on its right, 0 in the way, waited for, or out of view.
    """

    time: float
    status: Status
    s: Array
    l: Array  # noqa: E741 (the paper's letter)
    left: Array
    right: Array
    states: Array
    roll: Array
    states_s: Array
    states_time: Array
    solver_status: str
    iterations: int
    primal_residual: float
    dual_residual: float
    slack_corridor: float
    slack_slip: float
    feasible: bool
    solve_us: float
    step_us: float
    stop_distance: float = math.inf
    target_speed: float = 0.0
    acceleration: float = 0.0
    sides: tuple[int, ...] = ()

    def __repr__(self) -> str:
        way = f"{self.s[0]:.1f} to {self.s[-1]:.1f} m" if len(self.s) else "no way"
        return f"Plan({self.time:.2f} s, {self.status.name}, {way}, {self.solver_status})"

    def _repr_html_(self) -> str:
        facts = [
            ("status", self.status.name), ("solver", f"{self.solver_status}, {self.iterations} iterations"),
            ("way", f"{len(self.s)} stations"), ("prediction", f"{len(self.states)} states"),
            ("feasible", self.feasible), ("corridor slack", f"{1e3 * self.slack_corridor:.3f} mm"),
            ("step", f"{self.step_us:.0f} µs"),
        ]  # fmt: skip
        return facts_table(f"Plan at {self.time:.2f} s", facts)

    @classmethod
    def of(cls, plan: np.void, settings: np.void, obstacles: int, solve_us: float, step_us: float) -> "Plan":
        """A record of `PLAN` as a snapshot of its own.

        Args:
            plan: The record.
            settings: Record of `SETTINGS`.
            obstacles: How many the scene has.
            solve_us, step_us: Times, in [us].
        """
        grid, sides = settings["grid"], [0] * obstacles
        path, nodes = int(plan["layers"]), int(grid["nodes"]) + 1
        for index, side in zip(plan["ids"][: plan["obstacles"]].tolist(), plan["sides"].tolist(), strict=False):
            sides[index] = side
        return cls(
            time=float(plan["time"]), status=Status(plan["status"]),
            s=plan["s"][:path].copy(), l=plan["l"][:path].copy(), left=plan["left"][:path].copy(),
            right=plan["right"][:path].copy(), states=plan["states"][:nodes].copy(), roll=plan["roll"][:nodes].copy(),
            states_s=plan["states_s"][:nodes].copy(), states_time=np.concatenate([[0.0], grid["times"][: nodes - 1]]),
            solver_status=NAMES[plan["solver_status"]], iterations=int(plan["iterations"]),
            primal_residual=float(plan["primal_residual"]), dual_residual=float(plan["dual_residual"]),
            slack_corridor=float(plan["slack_corridor"]), slack_slip=float(plan["slack_slip"]),
            feasible=bool(plan["feasible"]), solve_us=solve_us, step_us=step_us,
            stop_distance=float(plan["stop_distance"]), target_speed=float(plan["target_speed"]),
            acceleration=float(plan["acceleration"]), sides=tuple(sides),
        )  # fmt: skip
