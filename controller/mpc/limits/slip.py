"""Slip angles stay below the tyres' peak; stands for (14)."""

from sidestep.controller.mpc.prediction import SLOWEST
from sidestep.plant_models.kernels import Record, kernel


@kernel
def slip(i: int, w: Record, c: Record) -> int:
    """Fill lines of the front and rear slip angle, softened by slack 1; see `limits.corridor`.

    `slip_limits` of the work space bounds them, front and rear, in [rad]; roll takes from both.
    """
    grid, car, free, response = c.grid, c.car, w.free, w.response
    for n in range(grid.slips):
        k = grid.slip_nodes[n]
        v = max(w.speed[k], SLOWEST)
        front, rear, roll_slip = car.l_f / v, car.l_r / v, w.forces[grid.group[k], 4]
        w.lines[i] = free[k, 4] - free[k, 2] - front * free[k, 3]
        w.lines[i + 1] = rear * free[k, 3] - free[k, 2]
        for q in range(grid.moves):
            w.slopes[i, q] = response[k, 4, q] - response[k, 2, q] - front * response[k, 3, q]
            w.slopes[i + 1, q] = rear * response[k, 3, q] - response[k, 2, q]
        for axle in range(2):
            w.low[i + axle], w.high[i + axle] = roll_slip - w.slip_limits[axle], roll_slip + w.slip_limits[axle]
            w.slack[i + axle] = 1
        i += 2
    return i
