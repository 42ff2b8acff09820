"""The paper's controller to the letter, kept as the baseline everything is compared with.

Forward Euler (7), the steering angle as input, the centre point inside (13) as hard rows, (14) as the only
input limit, (15) against the road's reference. What the paper leaves open (T, N_p, Q) is set here.
"""

import time

import numpy as np
import piqp
from numpy.typing import NDArray

from sidestep.controller.mpc.mpc import Problem, Solution
from sidestep.plant_models.linear.bicycle import continuous, euler
from sidestep.plant_models.vehicle.parameters import VehicleParameters

Array = NDArray[np.float64]

STEP, HORIZON = 0.05, 40
WEIGHT_OFFSET, WEIGHT_HEADING = 1.0, 1.0


class PaperMpc:
    """Builds and solves the paper's QP anew in every step."""

    def __init__(self, vehicle: VehicleParameters, weight_steer: float, max_lateral_acceleration: float):
        self.vehicle, self._r, self._a_max = vehicle, weight_steer, max_lateral_acceleration
        self.times: Array = STEP * np.arange(1.0, HORIZON + 1)
        self.problem: Problem | None = None

    def reset(self) -> None:
        """Nothing is kept from step to step."""

    def solve(self, x0: Array, speed: float, turn_rate: Array, bounds: Array, reference: float) -> Solution:
        """Solve (15), (16).

        Args:
            x0: Present state, of which the first four entries count, shape (6,).
            speed: v, in [m/s].
            turn_rate: Heading rate of the road during each step, shape (40,), in [rad/s].
            bounds: First two rows: (13) at the nodes, shape (4, 40), in [m].
            reference: l_ref, in [m].
        """
        began = time.perf_counter()
        p = self.problem = self._build(x0[:4], max(speed, 1.0), reference, turn_rate, bounds)
        built = time.perf_counter()
        solver = piqp.DenseSolver()
        solver.setup(p.P, p.c, None, None, p.G, p.h_l, p.h_u, p.x_l, p.x_u)
        status = solver.solve()
        ended = time.perf_counter()
        u = np.array(solver.result.x)
        states = np.zeros((HORIZON + 1, 6))
        states[0] = x0
        states[1:, :4] = self._free + np.tensordot(self._response, u, axes=1)
        states[1:, 4:] = u[:, None]
        excess = np.maximum(p.h_l - p.G @ u, p.G @ u - p.h_u).max()
        return Solution(
            z=u, states=states, status=status.name, solved=status == piqp.PIQP_SOLVED,
            iterations=int(solver.result.info.iter),
            primal_residual=float(solver.result.info.primal_res), dual_residual=float(solver.result.info.dual_res),
            slack_corridor=max(float(excess), 0.0), slack_slip=0.0,
            build_us=1e6 * (built - began), solve_us=1e6 * (ended - built),
        )  # fmt: skip

    def _build(self, x0: Array, v: float, reference: float, turn_rate: Array, bounds: Array) -> Problem:
        a, b, _ = continuous(self.vehicle, v)
        a_k, b_k = euler(a, b[:, None], STEP)
        free, response = np.empty((HORIZON, 4)), np.zeros((HORIZON, 4, HORIZON))
        x, s = x0, np.zeros((4, HORIZON))
        for k in range(HORIZON):
            x, s = a_k @ x, a_k @ s
            x[1] -= STEP * turn_rate[k]
            s[:, k] += b_k[:, 0]
            free[k], response[k] = x, s
        self._free, self._response = free, response
        offset, heading = response[:, 0], response[:, 1]
        hessian = WEIGHT_OFFSET * offset.T @ offset + WEIGHT_HEADING * heading.T @ heading + self._r * np.eye(HORIZON)
        gradient = WEIGHT_OFFSET * offset.T @ (free[:, 0] - reference) + WEIGHT_HEADING * heading.T @ free[:, 1]
        angle = min(np.arctan(self.vehicle.wheelbase * self._a_max / v**2), self.vehicle.steer_limit)  # (14)
        return Problem(
            P=np.asfortranarray(hessian), c=gradient, G=np.asfortranarray(offset),
            h_l=bounds[0] - free[:, 0], h_u=bounds[1] - free[:, 0],
            x_l=np.full(HORIZON, -angle), x_u=np.full(HORIZON, angle),
        )  # fmt: skip
