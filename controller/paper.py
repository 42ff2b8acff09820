"""The paper's controller to the letter, kept as the baseline everything is compared with.

Forward Euler (7), the steering angle as input, the centre point inside (13) as hard rows, (14) as the only
input limit, (15) against the road's reference. What the paper leaves open (T, N_p, Q) is set here.
"""

import math

import numpy as np
import piqp
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.mpc.piqp_solver import STATUS, Problem
from sidestep.controller.mpc.status import NUMERICS
from sidestep.controller.validity import Validity
from sidestep.plant_models.linear.bicycle import continuous, euler
from sidestep.plant_models.vehicle.parameters import VehicleParameters

Array = NDArray[np.float64]

STEP, HORIZON = 0.05, 40
WEIGHT_OFFSET, WEIGHT_HEADING = 1.0, 1.0


class PaperMpc:
    """Builds and solves the paper's QP anew in every step."""

    def __init__(self, vehicle: VehicleParameters, c: ControllerConfig):
        validity = Validity.of(c)
        valid = float(validity.by_speed(c.friction).min()) if validity else math.inf
        self.vehicle, self._r, self._reference = vehicle, c.weight_steer, c.reference_offset
        self._a_max = min(c.max_lateral_acceleration, valid)
        self.problem: Problem | None = None

    def solve(self, work: NDArray[np.void], _: Array) -> bool:
        """Solve (15), (16); whether that gave an optimum.

        Args:
            work: Work space record: present state `x0`, of which the first four entries count, `speed`, `turn_rate`
                and the first two rows of `bounds`, (13) at the nodes; `states` and the solver's figures are filled.
        """
        w = work[0]
        x0, bounds = w["x0"], w["bounds"][:, :HORIZON]
        p = self.problem = self._build(x0[:4], max(w["speed"][0], 1.0), self._reference, w["turn_rate"], bounds)
        solver = piqp.DenseSolver()
        solver.setup(p.P, p.c, None, None, p.G, p.h_l, p.h_u, p.x_l, p.x_u)
        status, info = solver.solve(), solver.result.info
        u, states = np.array(solver.result.x), w["states"]
        states[0] = x0
        states[1 : HORIZON + 1, :4] = self._free + np.tensordot(self._response, u, axes=1)
        states[1 : HORIZON + 1, 4:] = u[:, None]
        excess = np.maximum(p.h_l - p.G @ u, p.G @ u - p.h_u).max()
        work["slack_corridor"], work["slack_slip"] = max(float(excess), 0.0), 0.0
        work["solver_status"], work["iterations"] = STATUS.get(status, NUMERICS), info.iter
        work["primal_residual"], work["dual_residual"] = info.primal_res, info.dual_res
        return status == piqp.PIQP_SOLVED

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
