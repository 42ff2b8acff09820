"""Steering rate, and the lateral jerk that it makes in the end."""

from sidestep.controller.mpc.prediction import SLOWEST, steady_gain
from sidestep.plant_models.kernels import Record, kernel


@kernel
def effort(k: int, w: Record, c: Record) -> float:
    """Curvature of the cost in the move of node k, per unit of its time: `weight_rate` and `weight_jerk`."""
    return c.weights.rate + c.weights.jerk * steady_gain(max(w.speed[k], SLOWEST), c.car) ** 2
