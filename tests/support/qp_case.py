"""Random QPs of the MPC, stacked as a step stacks them, for the tests of its parts."""

import numpy as np

from sidestep.controller import ControllerConfig
from sidestep.controller.mpc.condense import condense
from sidestep.controller.mpc.piqp_solver import PiqpSolver
from sidestep.controller.mpc.prediction import linearise
from sidestep.controller.mpc.stack import SLACK_UNIT, stack_costs, stack_limits
from sidestep.controller.mpc.unconstrained import solve_freely
from sidestep.controller.records import SLACKS, WORK, record
from sidestep.controller.settings import settings_of
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
CONFIG = ControllerConfig(weight_offset=4.0, weight_acceleration=0.05)


class Qp:
    """Work space and settings of one step; `stack` after every change."""

    def __init__(self, seed: int, vehicle: VehicleParameters = BMW, config: ControllerConfig = CONFIG):
        self.settings, self.work = settings_of(vehicle, config), record(WORK)
        self.c, self.w = self.settings[0], self.work[0]
        self.grid = self.c["grid"]
        self.nodes, self.moves = n, _ = int(self.grid["nodes"]), int(self.grid["moves"])
        self.times = self.grid["times"][:n]
        rng, w, spread = np.random.default_rng(seed), self.w, [0.5, 0.05, 0.02, 0.1, 0.03, 0.03]
        w["x0"][:], w["speed"][:], w["group_speed"][:] = rng.normal(0.0, spread), 15.0, 15.0
        middle, width = rng.normal(0.0, 0.5, (2, n)).cumsum(axis=1) * 0.1, rng.uniform(0.2, 2.0, (2, n))
        w["bounds"][0::2, :n], w["bounds"][1::2, :n] = middle - width, middle + width
        w["path"][:n], w["turn_rate"][:n] = rng.normal(0.0, 0.3, n), rng.normal(0.0, 0.05, n)
        w["tracking_share"][:n], w["slip_limits"][:] = rng.uniform(0.03, 1.0, n), 0.1
        w["before"][: n + 1] = rng.normal(0.0, spread, (n + 1, 6))
        w["disturbance"][:] = rng.normal(0.0, 200.0, 2)
        self.solver = PiqpSolver(self.moves, self.count, vehicle.steer_rate_limit)
        self.last = np.zeros(self.moves)

    @property
    def count(self) -> int:
        """Bounded lines."""
        return 2 * (self.nodes - int(self.grid["first"])) + 2 * int(self.grid["slips"]) + self.moves

    @property
    def z(self) -> np.ndarray:
        """Moves and slacks."""
        return self.w["z"][: self.moves + SLACKS].copy()

    @property
    def cost(self) -> tuple[np.ndarray, np.ndarray]:
        """P and q."""
        size = self.moves + SLACKS
        return self.w["P"][:size, :size].copy(), self.w["q"][:size].copy()

    @property
    def states(self) -> np.ndarray:
        """Predicted at the nodes for `z`, shape (N, 6)."""
        response = self.w["response"][: self.nodes, :, : self.moves]
        return self.w["free"][: self.nodes] + response @ self.z[: self.moves]

    def stack(self) -> "Qp":
        linearise(self.w, self.c)
        condense(self.w, self.c)
        stack_costs(self.w, self.c)
        stack_limits(self.w, self.c)
        assert self.w["count"] == self.count
        return self

    def solve(self) -> bool:
        """Stack, then solve without bounds, or with; whether PIQP was asked."""
        self.stack()
        if solve_freely(self.w, self.c):
            return False
        assert self.solver.solve(self.work, self.last)
        self.last = self.z[: self.moves]
        return True

    def all_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """G and h of G z <= h with both bounds of every line."""
        w, m, count = self.w, self.moves, self.count
        slopes, slack = w["slopes"][:count, :m], w["slack"][:count]
        rows = np.zeros((2 * count, m + SLACKS))
        rows[:count, :m], rows[count:, :m] = slopes, -slopes
        soft = np.flatnonzero(slack < SLACKS)
        rows[soft, m + slack[soft]] = rows[soft + count, m + slack[soft]] = -SLACK_UNIT
        lines = w["lines"][:count]
        return rows, np.concatenate([w["high"][:count] - lines, lines - w["low"][:count]])
