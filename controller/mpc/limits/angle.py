"""The commanded road-wheel angle stays within the actuator's range."""

from sidestep.controller.records import SLACKS
from sidestep.plant_models.kernels import Record, kernel


@kernel
def angle(i: int, w: Record, c: Record) -> int:
    """Fill a hard line of the commanded angle after each move; see `limits.corridor`."""
    grid = c.grid
    for k in range(grid.nodes):
        if k == grid.nodes - 1 or grid.block[k + 1] != grid.block[k]:
            w.lines[i] = w.free[k, 5]
            for q in range(grid.moves):
                w.slopes[i, q] = w.response[k, 5, q]
            w.low[i], w.high[i], w.slack[i] = -c.car.steer_limit, c.car.steer_limit, SLACKS
            i += 1
    return i
