"""The multi-constraint MPC (14)-(16) as one small dense QP, solved by PIQP.

Decision z = [blocked steering rates, corridor slack, slip slack]; the states are condensed out. Rows:
front and rear end of the footprint inside the corridor (soft), front and rear slip angle within the
tyre's bound (soft), commanded angle within its limit (hard); the rate limit is a box on z.
"""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import piqp
from numba import njit
from numpy.typing import NDArray

from sidestep.controller.prediction import STATES, grid, stage_matrices, steady_gain

Array = NDArray[np.float64]

FIRST_CORRIDOR_TIME = 0.1
"""Earlier nodes get no corridor rows, in [s]: steering cannot move the car by a millimetre by then."""


SLACK_UNIT, SLACK_CURVATURE = 0.01, 1e3
"""Slack is counted in centimetres and hundredths of a radian: with all variables of one order PIQP needs no
preconditioner and half the iterations. The quadratic cost only keeps the QP strictly convex."""


class MpcWeights(NamedTuple):
    """Quadratic and linear costs, see ControllerConfig."""

    offset: float
    lateral_speed: float
    acceleration: float
    jerk: float
    rate: float
    corridor: float
    slip: float


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


@dataclass(frozen=True)
class Solution:
    """What one solve gave.

    Attributes:
        z: Optimum, shape (n,).
        states: Predicted states of `prediction`, first the present one, shape (N + 1, 6).
        status: PIQP's status, in words.
        solved: Whether it is an optimum.
        iterations, primal_residual, dual_residual: PIQP's own figures.
        slack_corridor: How far the corridor is left, in [m].
        slack_slip: How far the slip bound is left, in [rad].
        build_us, solve_us: Time spent, in [us].
    """

    z: Array
    states: Array
    status: str
    solved: bool
    iterations: int
    primal_residual: float
    dual_residual: float
    slack_corridor: float
    slack_slip: float
    build_us: float
    solve_us: float


@njit(cache=True, nogil=True)
def build_qp(x0, speed, car, period, level, block, path, slope, turn_rate, bounds, front, rear, rows, slip_limit,
             steer_limit, weights, P, c, G, h_l, h_u, free, response):  # fmt: skip
    """Fill the QP in place.

    Args:
        x0: Present state, shape (6,).
        speed: v, in [m/s].
        car: See `prediction.model_block`.
        period: Shortest step, in [s]; step k lasts period 2^level[k] and uses move block[k].
        level, block: Shape (N,).
        path, slope: Reference offset [m] and heading [rad] at the nodes, shape (N,).
        turn_rate: Heading rate of the road during each step, shape (N,), in [rad/s].
        bounds: right and left at the front, right and left at the rear for the car's centre line, shape (4, N), in [m].
        front, rear: Distance of the footprint's ends from the centre of gravity, in [m].
        rows: First node with corridor rows, and the nodes with slip rows from index 1 on.
        slip_limit, steer_limit: In [rad].
        weights: MpcWeights.
        P, c, G, h_l, h_u: Filled; G in Fortran order.
        free, response: Filled: states without moves, shape (N, 6), and their slope, shape (N, 6, moves).
    """
    n_nodes, moves = level.shape[0], response.shape[2]
    m, _, l_f, l_r, c_f, c_r, _ = car
    v = max(speed, 1.0)
    stages = stage_matrices(speed, car, period, level.max() + 1)
    effort = weights.rate + weights.jerk * steady_gain(v, car) ** 2

    P[:, :] = 0.0
    c[:] = 0.0
    G[:, :] = 0.0
    before_free = x0.copy()
    before = np.zeros((STATES, moves))
    y = np.empty((3, moves))
    for k in range(n_nodes):
        e = stages[level[k]]
        for i in range(STATES):
            value = e[i, 7] * turn_rate[k]
            for j in range(STATES):
                value += e[i, j] * before_free[j]
            free[k, i] = value
            for q in range(moves):
                value = 0.0
                for j in range(STATES):
                    value += e[i, j] * before[j, q]
                response[k, i, q] = value
            response[k, i, block[k]] += e[i, 6]
        before_free, before = free[k], response[k]

        # a_y = (C_f alpha_f + C_r alpha_r) / m
        a_beta, a_gamma, a_delta = -(c_f + c_r) / m, -(l_f * c_f - l_r * c_r) / (m * v), c_f / m
        dt = period * 2.0 ** level[k]
        scale = dt / 0.1 * (3.0 if k == n_nodes - 1 else 1.0)
        w_l, w_e, w_a = scale * weights.offset, scale * weights.lateral_speed * v * v, scale * weights.acceleration
        r_l, r_e = free[k, 0] - path[k], free[k, 1] - slope[k]
        r_a = a_beta * free[k, 2] + a_gamma * free[k, 3] + a_delta * free[k, 4]
        for q in range(block[k] + 1):
            y[0, q], y[1, q] = response[k, 0, q], response[k, 1, q]
            y[2, q] = a_beta * response[k, 2, q] + a_gamma * response[k, 3, q] + a_delta * response[k, 4, q]
        for q in range(block[k] + 1):
            c[q] += w_l * r_l * y[0, q] + w_e * r_e * y[1, q] + w_a * r_a * y[2, q]
            for r in range(q + 1):
                P[q, r] += w_l * y[0, q] * y[0, r] + w_e * y[1, q] * y[1, r] + w_a * y[2, q] * y[2, r]
        P[block[k], block[k]] += dt / 0.1 * effort
    for q in range(moves):
        for r in range(q):
            P[r, q] = P[q, r]
    P[moves, moves] = P[moves + 1, moves + 1] = SLACK_CURVATURE * SLACK_UNIT**2
    c[moves], c[moves + 1] = weights.corridor * SLACK_UNIT, weights.slip * SLACK_UNIT

    row = 0
    for k in range(rows[0], n_nodes):
        for end in range(2):
            lever = front if end == 0 else -rear
            offset = free[k, 0] + lever * free[k, 1]
            for q in range(moves):
                G[row, q] = G[row + 1, q] = response[k, 0, q] + lever * response[k, 1, q]
            G[row, moves], G[row + 1, moves] = SLACK_UNIT, -SLACK_UNIT
            h_l[row], h_u[row] = bounds[2 * end, k] - offset, np.inf
            h_l[row + 1], h_u[row + 1] = -np.inf, bounds[2 * end + 1, k] - offset
            row += 2
    for index in range(1, rows.shape[0]):
        k = rows[index]
        for axle in range(2):
            w_delta, w_gamma = (1.0, -l_f / v) if axle == 0 else (0.0, l_r / v)
            slip = w_delta * free[k, 4] - free[k, 2] + w_gamma * free[k, 3]
            for q in range(moves):
                G[row, q] = G[row + 1, q] = (
                    w_delta * response[k, 4, q] - response[k, 2, q] + w_gamma * response[k, 3, q]
                )
            G[row, moves + 1], G[row + 1, moves + 1] = SLACK_UNIT, -SLACK_UNIT
            h_l[row], h_u[row] = -slip_limit - slip, np.inf
            h_l[row + 1], h_u[row + 1] = -np.inf, slip_limit - slip
            row += 2
    for k in range(n_nodes):
        if k == n_nodes - 1 or block[k + 1] != block[k]:
            for q in range(moves):
                G[row, q] = response[k, 5, q]
            h_l[row], h_u[row] = -steer_limit - free[k, 5], steer_limit - free[k, 5]
            row += 1


class Mpc:
    """Builds and solves the QP of one car, reusing its memory from step to step."""

    def __init__(self, car: Array, front: float, rear: float, period: float, weights: MpcWeights,
                 slip_limit: float, steer_limit: float, rate_limit: float):  # fmt: skip
        self.period = period
        self.level, self.block = grid(period)
        self.times = np.cumsum(period * 2.0**self.level)
        nodes, moves = len(self.level), int(self.block[-1]) + 1
        first = int(np.searchsorted(self.times, FIRST_CORRIDOR_TIME))
        self._rows = np.concatenate([[first], np.arange(2, min(nodes, 17), 2)])
        count = 4 * (nodes - first) + 4 * (len(self._rows) - 1) + moves
        size = moves + 2
        self._args = (car, period, self.level, self.block)
        self._limits = (front, rear, self._rows, slip_limit, steer_limit, weights)
        self.problem = Problem(
            P=np.zeros((size, size), order="F"), c=np.zeros(size), G=np.zeros((count, size), order="F"),
            h_l=np.empty(count), h_u=np.empty(count),
            x_l=np.concatenate([np.full(moves, -rate_limit), np.zeros(2)]),
            x_u=np.concatenate([np.full(moves, rate_limit), np.full(2, np.inf)]),
        )  # fmt: skip
        self._free, self._response = np.empty((nodes, STATES)), np.empty((nodes, STATES, moves))
        self._solver: piqp.DenseSolver | None = None

    def solve(self, x0: Array, speed: float, path: Array, slope: Array, turn_rate: Array, bounds: Array) -> Solution:
        """Solve the step; arguments as in `build_qp`, all finite."""
        began = time.perf_counter()
        p = self.problem
        build_qp(x0, speed, *self._args, path, slope, turn_rate, bounds, *self._limits,
                 p.P, p.c, p.G, p.h_l, p.h_u, self._free, self._response)  # fmt: skip
        built = time.perf_counter()
        solver = self._solver
        if solver is None:
            solver = self._solver = piqp.DenseSolver()
            solver.settings.eps_abs, solver.settings.eps_rel, solver.settings.tau = 1e-8, 1e-9, 0.999
            solver.settings.preconditioner_iter = 0
            solver.setup(p.P, p.c, None, None, p.G, p.h_l, p.h_u, p.x_l, p.x_u)
        else:
            solver.update(P=p.P, c=p.c, G=p.G, h_l=p.h_l, h_u=p.h_u)
        status = solver.solve()
        ended = time.perf_counter()
        result = solver.result
        z = np.array(result.x)  # a view that the next solve overwrites
        moves = self._response.shape[2]
        states = np.vstack([x0, self._free + self._response @ z[:moves]])
        return Solution(
            z=z, states=states, status=str(status).rpartition(".")[2], solved=status == piqp.PIQP_SOLVED,
            iterations=int(result.info.iter),
            primal_residual=float(result.info.primal_res), dual_residual=float(result.info.dual_res),
            slack_corridor=SLACK_UNIT * float(z[moves]), slack_slip=SLACK_UNIT * float(z[moves + 1]),
            build_us=1e6 * (built - began), solve_us=1e6 * (ended - built),
        )  # fmt: skip
