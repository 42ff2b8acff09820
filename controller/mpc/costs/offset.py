"""Distance to the planned path."""

from sidestep.plant_models.kernels import Record, kernel


@kernel
def offset(row: int, k: int, dt: float, w: Record, c: Record) -> None:
    """Residual l - l_path of node k, weighted by `weight_offset` and by how much the path counts there.

    Args:
        row: Of `residual`, `gradient` and `weight` in the work space, which it fills.
        k: Node.
        dt: Time that the node stands for, in units of the cost.
        w, c: Work space and settings.
    """
    w.residual[row] = w.free[k, 0] - w.path[k]
    w.weight[row] = dt * w.tracking_share[k] * c.weights.offset
    for q in range(c.grid.block[k] + 1):
        w.gradient[row, q] = w.response[k, 0, q]
