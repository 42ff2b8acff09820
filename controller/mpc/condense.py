"""Condensing: the predicted states as a free response plus a slope in the moves."""

from sidestep.controller.mpc.discretise import exponential, square
from sidestep.controller.mpc.prediction import FRONT, RATE, REAR, TURN, model_block
from sidestep.controller.records import STATES
from sidestep.plant_models.kernels import Record, kernel


@kernel
def condense(w: Record, c: Record) -> None:
    """States at the nodes as free response plus slope in the moves.

    Step k lasts period 2^level[k] at speed[k], uses move block[k] and the axle forces of group[k].

    Args:
        w: Work space: `x0`, `speed` [m/s], `turn_rate` of the road [rad/s] and `forces` are read; `free` and
            `response` are filled.
        c: Settings.
    """
    grid = c.grid
    for k in range(grid.nodes):
        _discretise(k, w, c)
        _propagate(k, w, grid)


@kernel
def _discretise(k, w, c):
    """[A_k, B_k] of step k; twice the step before, or the same again, wherever that is so."""
    grid, line = c.grid, w.forces[c.grid.group[k]]
    if k > 0:
        last = w.forces[grid.group[k - 1]]
        same = line[0] == last[0] and line[2] == last[2] and w.speed[k] == w.speed[k - 1]
        if same and grid.level[k] == grid.level[k - 1]:
            return
        if same and grid.level[k] == grid.level[k - 1] + 1:
            square(w.exponential, w.products[0])
            return
    model_block(w.speed[k], line[0], line[2], c.car, w.generator)
    exponential(w.generator, grid.steps[k], w.exponential, w.products)


@kernel
def _propagate(k, w, grid):
    e, line, free, response = w.exponential, w.forces[grid.group[k]], w.free, w.response
    moved = grid.block[k - 1] + 1 if k > 0 else 0  # moves that the state before depends on
    for i in range(STATES):
        value = e[i, TURN] * w.turn_rate[k] + e[i, FRONT] * line[1] + e[i, REAR] * line[3]
        for j in range(STATES):
            value += e[i, j] * (free[k - 1, j] if k > 0 else w.x0[j])
        free[k, i] = value
        l, phi, beta, gamma, delta, commanded = e[i, 0], e[i, 1], e[i, 2], e[i, 3], e[i, 4], e[i, 5]  # noqa: E741
        for q in range(moved):  # written out, the compiler makes vectors of it
            response[k, i, q] = (l * response[k - 1, 0, q] + phi * response[k - 1, 1, q]
                                 + beta * response[k - 1, 2, q] + gamma * response[k - 1, 3, q]
                                 + delta * response[k - 1, 4, q] + commanded * response[k - 1, 5, q])  # fmt: skip
        for q in range(moved, grid.moves):
            response[k, i, q] = 0.0
        response[k, i, grid.block[k]] += e[i, RATE]
