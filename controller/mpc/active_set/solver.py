"""The active set as the solver of the step."""

from sidestep.controller.mpc import status
from sidestep.controller.mpc.active_set.iteration import EXHAUSTED, INFEASIBLE, SOLVED, solve
from sidestep.controller.mpc.stack import SLACK_CURVATURE
from sidestep.controller.records import PADDING, SLACKS
from sidestep.plant_models.kernels import Record, bare_kernel

MOST_ITERATIONS = 200
"""Three times what the worst hostile step takes."""


@bare_kernel
def solve_with_bounds(m: Record, p: Record, c: Record) -> bool:
    """Solve the stacked QP, beginning with the active bounds of the last step.

    Args:
        m: Memory; keeps the active bounds.
        p: Work space with the stacked QP; `z` and the solver's figures are filled.
        c: Settings.

    Returns:
        Whether that gave the optimum.
    """
    w = p.active
    size(w, c.grid.moves, SLACKS)
    for q in range(w.moves):
        w.x_lower[q], w.x_upper[q] = -c.car.rate_limit, c.car.rate_limit
    w.price[0], w.price[1] = c.weights.corridor, c.weights.slip
    w.curvature[0] = w.curvature[1] = SLACK_CURVATURE
    w.ends[0] = 2 * (c.grid.nodes - c.grid.first)
    w.ends[1] = w.ends[0] + 2 * c.grid.slips
    found, p.iterations = solve(p, m.active, MOST_ITERATIONS, w)
    p.primal_residual = p.dual_residual = 0.0
    p.solver_status = status.NUMERICS
    if found == SOLVED:
        p.solver_status = status.SOLVED
    elif found == INFEASIBLE:
        p.solver_status = status.INFEASIBLE
    elif found == EXHAUSTED:
        p.solver_status = status.ITERATION_LIMIT
    return found == SOLVED


@bare_kernel
def size(w: Record, moves: int, slacks: int) -> None:
    """Sizes of a problem in the work space."""
    w.moves, w.slacks = moves, slacks
    w.width = -(-(moves + slacks) // PADDING) * PADDING
