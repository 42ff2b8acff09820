"""Lateral speed against the planned path."""

from sidestep.controller.mpc.prediction import SLOWEST
from sidestep.plant_models.kernels import Record, kernel


@kernel
def lateral_speed(row: int, k: int, dt: float, w: Record, c: Record) -> None:
    """Residual e_phi - heading of the path of node k, weighted by `weight_lateral_speed` v^2; see `costs.offset`."""
    v = max(w.speed[k], SLOWEST)
    w.residual[row] = w.free[k, 1] - w.heading[k]
    w.weight[row] = dt * w.tracking_share[k] * c.weights.lateral_speed * v * v
    for q in range(c.grid.block[k] + 1):
        w.gradient[row, q] = w.response[k, 1, q]
