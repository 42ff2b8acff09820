"""The QP of the MPC (15), (16): the cost terms summed, the limits one under the other.

Decision z = [blocked steering rates, corridor slack, slip slack]; the states are condensed out. What is bounded are
lines: value without moves, slope in the moves, a lower and an upper bound, and the slack that softens them. The stack
knows none of the terms and limits: each is a file of `costs` or `limits`.
"""

from sidestep.controller.mpc.costs.acceleration import acceleration
from sidestep.controller.mpc.costs.effort import effort
from sidestep.controller.mpc.costs.lateral_speed import lateral_speed
from sidestep.controller.mpc.costs.offset import offset
from sidestep.controller.mpc.limits.angle import angle
from sidestep.controller.mpc.limits.corridor import corridor
from sidestep.controller.mpc.limits.slip import slip
from sidestep.controller.records import SLACKS
from sidestep.plant_models.kernels import Record, kernel

SLACK_UNIT, SLACK_CURVATURE = 0.01, 1e3
"""Slack is counted in centimetres and hundredths of a radian: with all variables of one order PIQP needs no
preconditioner and half the iterations. The quadratic cost only keeps the QP strictly convex."""
COST_STEP = 0.1
"""Costs are integrals over time, counted per this, in [s]."""
TERMINAL_WEIGHT = 3.0
TERMS = 3
"""Residuals of a node."""


@kernel
def stack_costs(w: Record, c: Record) -> None:
    """Sum the cost terms into 1/2 z'Pz + q'z; Eq. (15).

    Args:
        w: Work space, condensed; `P` and `q` are filled, on and above the diagonal and then mirrored.
        c: Settings.
    """
    grid = c.grid
    moves = grid.moves
    P, g = w.P, w.q
    P[: moves + SLACKS, : moves + SLACKS] = 0.0
    g[: moves + SLACKS] = 0.0
    for k in range(grid.nodes):
        dt = grid.steps[k] / COST_STEP
        P[grid.block[k], grid.block[k]] += dt * effort(k, w, c)
        if k == grid.nodes - 1:
            dt *= TERMINAL_WEIGHT
        offset(0, k, dt, w, c)
        lateral_speed(1, k, dt, w, c)
        acceleration(2, k, dt, w, c)
        _add_squares(grid.block[k] + 1, w)
    for q in range(moves):
        for r in range(q):
            P[r, q] = P[q, r]
    P[moves, moves] = P[moves + 1, moves + 1] = SLACK_CURVATURE * SLACK_UNIT**2
    g[moves], g[moves + 1] = c.weights.corridor * SLACK_UNIT, c.weights.slip * SLACK_UNIT


@kernel
def _add_squares(count, w):
    """Half the weighted squares of a node's residuals, which depend on the first `count` moves."""
    P, g, y = w.P, w.q, w.gradient
    for q in range(count):
        l, e, a = w.weight[0] * y[0, q], w.weight[1] * y[1, q], w.weight[2] * y[2, q]  # noqa: E741
        g[q] += l * w.residual[0] + e * w.residual[1] + a * w.residual[2]
        for r in range(q + 1):
            P[q, r] += l * y[0, r] + e * y[1, r] + a * y[2, r]


@kernel
def stack_limits(w: Record, c: Record) -> None:
    """Fill the bounded lines; Eq. (16). Each limit takes the first free line and gives back the next one."""
    w.count = angle(slip(corridor(0, w, c), w, c), w, c)
