"""Lateral acceleration: the sum of the axle forces over the mass."""

from sidestep.controller.mpc.prediction import SLOWEST
from sidestep.plant_models.kernels import Record, kernel


@kernel
def acceleration(row: int, k: int, dt: float, w: Record, c: Record) -> None:
    """Residual a_y of node k, weighted by `weight_acceleration`; see `costs.offset`."""
    car, line, v = c.car, w.forces[c.grid.group[k]], max(w.speed[k], SLOWEST)
    slope_f, force_f, slope_r, force_r = line[0], line[1], line[2], line[3]
    beta, delta = -(slope_f + slope_r) / car.mass, slope_f / car.mass
    gamma = (car.l_r * slope_r - car.l_f * slope_f) / (car.mass * v)
    free, response = w.free, w.response
    w.residual[row] = beta * free[k, 2] + gamma * free[k, 3] + delta * free[k, 4] + (force_f + force_r) / car.mass
    w.weight[row] = dt * c.weights.acceleration
    for q in range(c.grid.block[k] + 1):
        w.gradient[row, q] = beta * response[k, 2, q] + gamma * response[k, 3, q] + delta * response[k, 4, q]
