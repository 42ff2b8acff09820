"""What the controller thought in its last step."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
        plan_us, build_us, solve_us, step_us: Time for path search, QP, solver and the whole step, in [us].
        stop_distance: Free distance before what blocks the road, in [m]; infinite if nothing does.
        target_speed: As sent with the command, in [m/s].
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
    plan_us: float
    build_us: float
    solve_us: float
    step_us: float
    stop_distance: float = math.inf
    target_speed: float = 0.0
    sides: tuple[int, ...] = ()

    @classmethod
    def empty(cls, times: Array) -> "Plan":
        """What there is before the first state: a FAULT at standstill, at the node times in [s]."""
        nothing, count = np.zeros(0), len(times)
        return cls(
            time=0.0, status=Status.FAULT, s=nothing, l=nothing, left=nothing, right=nothing,
            states=np.zeros((count, 6)), roll=np.zeros((count, 2)), states_s=np.zeros(count), states_time=times,
            solver_status="", iterations=0, primal_residual=0.0, dual_residual=0.0, slack_corridor=0.0,
            slack_slip=0.0, feasible=False, plan_us=0.0, build_us=0.0, solve_us=0.0, step_us=0.0,
        )  # fmt: skip
