"""The prediction grid: where its nodes are, and which share a move and a tangent."""

import math

import numpy as np
from numpy.typing import NDArray

HORIZON, COARSEST_STEP = 2.58, 0.16
"""Length of the prediction and of its longest step, in [s]."""


def grid(period: float) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Prediction grid: fine where the car is, coarse ahead, every step the first times a power of two.

    Args:
        period: Control period, in [s].

    Returns:
        level (N,) such that step k lasts period 2^level[k], the control move (N,) that acts in it, and the
        group (N,) of steps, of one level each, that share their axle forces: no longer than the coarsest step.
    """
    coarsest = max(round(math.log2(COARSEST_STEP / period)), 0)
    level = [0] * 3
    for i in range(1, coarsest):
        level += [i] * (3 if i == 1 else 4)
    rest = HORIZON - period * sum(2**i for i in level)
    level += [coarsest] * max(round(rest / (period * 2**coarsest)), 1)
    lengths = [1] * 6 + [2] * 4
    lengths += [3] * math.ceil(max(len(level) - sum(lengths), 0) / 3)
    block = np.repeat(np.arange(len(lengths)), lengths)[: len(level)]
    steps = np.array(level)
    since = np.arange(len(steps)) - np.searchsorted(steps, steps)  # steps of this level before
    group = np.cumsum((since % 2 ** (coarsest - steps) == 0).astype(np.int64)) - 1
    return steps, block, group
