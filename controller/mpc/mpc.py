"""The multi-constraint MPC: fills the QP of one step and has PIQP solve it where a bound acts."""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import piqp
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.decision.corridor import FIRST_CORRIDOR_TIME
from sidestep.controller.mpc.car_model import Car
from sidestep.controller.mpc.prediction import STATES, Prediction, grid, linearise
from sidestep.controller.mpc.qp import (
    NEAREST,
    RESERVE,
    SLACKS,
    add_violated,
    condense,
    fill_cost,
    fill_lines,
    fill_rows,
    solve_freely,
)
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.vehicle.parameters import VehicleParameters

Array = NDArray[np.float64]

EPS = 1e-9
"""Absolute accuracy asked of PIQP, its duality gap included: 1e-8 leaves errors above 1e-5 rad/s in the first move."""
UNCONSTRAINED = "UNCONSTRAINED"
"""Status of an optimum that no bound acts on."""
STEP_SHARE = 0.999
"""Share of the way to the nearest bound that PIQP goes in an iteration: its own 0.99 costs one iteration of seven."""
MAX_ITERATIONS = 60
"""Ten times what a step takes; beyond, the solver is stuck."""
TOLERANCE = 1e-6
"""Violation of a bound without a row that is let pass, in [m] or [rad]."""


class MpcWeights(NamedTuple):
    """Quadratic costs and linear penalties, see ControllerConfig."""

    offset: float
    lateral_speed: float
    acceleration: float
    jerk: float
    rate: float
    corridor: float
    slip: float


class Limits(NamedTuple):
    """Bounds of commanded angle [rad] and rate [rad/s]; front and rear end of the footprint [m]."""

    steer: float
    rate: float
    levers: tuple[float, float]


@dataclass(frozen=True)
class Problem:
    """min 1/2 z'Pz + c'z with h_l <= G z <= h_u and x_l <= z <= x_u."""

    P: Array
    c: Array
    G: Array
    h_l: Array
    h_u: Array
    x_l: Array
    x_u: Array


class Solution(NamedTuple):
    """What one step's solve gave.

    Attributes:
        z: Optimum, shape (n,).
        status: PIQP's status, in words; UNCONSTRAINED if it was not needed.
        solved: Whether it is an optimum.
        iterations, primal_residual, dual_residual: PIQP's own figures; iterations summed over rounds.
        slack_corridor: How far the prediction leaves the corridor, in [m].
        slack_slip: How far it leaves the slip bound, in [rad].
        states: Predicted states of `prediction`, first the present one, shape (N + 1, 6).
        build_us, solve_us: Time spent, in [us].
    """

    z: Array
    status: str
    solved: bool
    iterations: int
    primal_residual: float
    dual_residual: float
    slack_corridor: float
    slack_slip: float
    states: Array
    build_us: float
    solve_us: float


@kernel
def _fill(x0, speed, path, heading, firmness, turn_rate, bounds, times, states, roll, age, disturbance, slip_limits,
          car, grid, force_times, weights, limits, first, slip_nodes, free, response, forces, lines, P, c,
          z):  # fmt: skip
    period, level, block, group = grid
    linearise(force_times + age, times, states, roll, speed, disturbance, car, forces)
    condense(x0, speed, car, period, level, block, group, forces, turn_rate, free, response)
    fill_cost(speed, car, period, level, block, group, forces, path, heading, firmness, weights, free, response, P, c)
    values, slopes, low, high = lines
    fill_lines(speed, car, limits.levers, bounds, first, slip_nodes, slip_limits, limits.steer, block, group, forces,
               free, response, values, slopes, low, high)  # fmt: skip
    return solve_freely(P, c, limits.rate, values, slopes, low, high, z)


@kernel
def _states(x0, z, free, response):
    states = np.empty((free.shape[0] + 1, STATES))
    states[0] = x0
    for k in range(free.shape[0]):
        for i in range(STATES):
            value = free[k, i]
            for q in range(response.shape[2]):
                value += response[k, i, q] * z[q]
            states[k + 1, i] = value
    return states


def set_up(p: Problem, preconditioner_rounds: int = 0) -> piqp.DenseSolver:
    """A PIQP solver for a problem, set as the controller sets it."""
    solver = piqp.DenseSolver()
    settings = solver.settings
    settings.eps_abs, settings.eps_rel, settings.max_iter = EPS, 0.1 * EPS, MAX_ITERATIONS
    settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = 0.1 * EPS, 0.1 * EPS
    settings.preconditioner_iter, settings.tau = preconditioner_rounds, STEP_SHARE
    solver.setup(p.P, p.c, None, None, p.G, p.h_l, p.h_u, p.x_l, p.x_u)
    return solver


class _Rows:
    """One QP in memory and the solver that knows its size."""

    def __init__(self, moves: int, rows: int, rate: float):
        size = moves + SLACKS
        self.problem = p = Problem(
            P=np.asfortranarray(np.eye(size)), c=np.zeros(size), G=np.zeros((rows, size), order="F"),
            h_l=np.full(rows, -np.inf), h_u=np.ones(rows),
            x_l=np.concatenate([np.full(moves, -rate), np.zeros(SLACKS)]),
            x_u=np.concatenate([np.full(moves, rate), np.full(SLACKS, np.inf)]),
        )  # fmt: skip
        self.cost, self.rows = (p.P, p.c), (p.G, p.h_l, p.h_u)
        self._solver = set_up(p)

    def solve(self) -> tuple[piqp.Status, piqp.Result]:
        """Solve what is in `problem`; the result's arrays are overwritten by the next call."""
        p = self.problem
        self._solver.update(P=p.P, c=p.c, G=p.G, h_l=p.h_l, h_u=p.h_u)
        status, result = self._solver.solve(), self._solver.result
        if status != piqp.PIQP_SOLVED:  # stuck, which scaling by PIQP itself mostly heals
            careful = set_up(p, 10)
            status, result = careful.solve(), careful.result
        return status, result


class Mpc:
    """Builds and solves the QPs of one car, reusing its memory from step to step.

    Attributes:
        moves: Steering rates of the last solution, shape (n,), in [rad/s]: all that one step leaves to the next.
    """

    def __init__(self, period: float, weights: MpcWeights, limits: Limits):
        self.level, self.block, self.group = grid(period)
        self.times: Array = np.cumsum(period * 2.0**self.level, dtype=np.float64)
        nodes, moves = len(self.level), int(self.block[-1]) + 1
        first = int(np.searchsorted(self.times, FIRST_CORRIDOR_TIME))
        slip_nodes = np.arange(2, min(nodes, 17), 2)
        corridor = 2 * (nodes - first)
        self.soft = (corridor, corridor + 2 * len(slip_nodes))
        count = self.soft[1] + moves
        begins = np.searchsorted(self.group, np.arange(int(self.group[-1]) + 2))
        edges = np.concatenate([[0.0], self.times])[begins]
        self._force_times: Array = 0.5 * (edges[1:] + edges[:-1])
        self.forces = np.empty((len(self._force_times), 5))
        self._grid = (period, self.level, self.block, self.group)
        self._limits, self._weights, self._line_nodes = limits, weights, (first, slip_nodes)
        self._prediction = (np.zeros((nodes, STATES)), np.zeros((nodes, STATES, moves)))
        self.lines = (np.empty(count), np.empty((count, moves)), np.empty(count), np.empty(count))
        self._reduced = _Rows(moves, NEAREST + RESERVE, limits.rate)
        self._full = _Rows(moves, 2 * count, limits.rate)
        self.reset()

    @classmethod
    def of(cls, vehicle: VehicleParameters, c: ControllerConfig) -> "Mpc":
        """For a car and a configuration."""
        weights = MpcWeights(
            c.weight_offset, c.weight_lateral_speed, c.weight_acceleration, c.weight_jerk, c.weight_rate,
            c.corridor_penalty, c.slip_penalty,
        )  # fmt: skip
        levers = (vehicle.front_extent, -vehicle.rear_extent)
        return cls(c.period, weights, Limits(vehicle.steer_limit, vehicle.steer_rate_limit, levers))

    @property
    def problem(self) -> Problem:
        """The QP of the last solve; the next one overwrites its arrays."""
        return (self._used or self._choose_rows()).problem

    def reset(self) -> None:
        """Forget the last solution, which only chooses the rows to begin with."""
        self._used: _Rows | None = self._reduced
        self.moves = np.zeros(self._prediction[1].shape[2])

    def solve(self, x0: Array, speed: float, path: Array, heading: Array, firmness: Array, turn_rate: Array,
              bounds: Array, before: Prediction, disturbance: tuple[float, float], slip_limits: tuple[float, float],
              car: Car) -> Solution:  # fmt: skip
        """Solve the step; arguments as in `qp` and `prediction.linearise`, all finite."""
        began = time.perf_counter()
        cost, z = self._reduced.cost, np.empty(len(self.moves) + SLACKS)
        kept = _fill(x0, speed, path, heading, firmness, turn_rate, bounds, *before, disturbance, slip_limits, car,
                     self._grid, self._force_times, self._weights, self._limits, *self._line_nodes,
                     *self._prediction, self.forces, self.lines, *cost, z)  # fmt: skip
        built = time.perf_counter()
        self._used = None
        found = (z, UNCONSTRAINED, True, 0, 0.0, 0.0, 0.0, 0.0) if kept else self._solve_rows()
        z, solved = found[0], found[2]
        if solved:
            self.moves = z[:-SLACKS]
        states = _states(x0, z, *self._prediction)
        return Solution(*found, states, 1e6 * (built - began), 1e6 * (time.perf_counter() - built))

    def _choose_rows(self) -> _Rows:
        self._used = self._reduced
        fill_rows(self.moves, self.soft, *self.lines, *self._reduced.rows)
        return self._reduced

    def _solve_rows(self) -> tuple[Array, str, bool, int, float, float, float, float]:
        """Solve with few rows and add what is violated; gives the first fields of Solution."""
        rows, used, iterations = self._choose_rows(), 0, 0
        while True:
            status, result = rows.solve()
            info = result.info
            iterations += int(info.iter)
            z = np.array(result.x)  # a view that the next solve overwrites
            known = used
            used, corridor, slip = add_violated(z, used, TOLERANCE, self.soft, *self.lines, *rows.rows)
            if used == known or status != piqp.PIQP_SOLVED or rows is self._full:
                break
            if used > RESERVE:
                rows = self._used = self._full
                for into, of in zip(rows.cost, self._reduced.cost, strict=True):
                    into[:] = of
                fill_rows(self.moves, self.soft, *self.lines, *rows.rows)
        return (
            z, status.name, status == piqp.PIQP_SOLVED, iterations, float(info.primal_res), float(info.dual_res),
            corridor, slip,
        )  # fmt: skip
