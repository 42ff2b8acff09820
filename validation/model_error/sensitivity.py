"""Which parameters matter: the share of a result's variance that each of them explains alone."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ks_2samp, rankdata

Array = NDArray[np.float64]

_PER_BIN = 12
_MOST_BINS = 50


def first_order(parameter: Array, result: Array) -> float:
    """First-order Sobol index Var(E[result | parameter]) / Var(result), from given samples.

    The conditional mean is that within bins of equally many samples (one bin a value where there are few); what
    chance explains is taken off, as in the adjusted coefficient of determination (Kelley 1935), and negative
    estimates are 0.

    Args:
        parameter: Shape (n,); numbers, or whole numbers that stand for names.
        result: Shape (n,).
    """
    levels, bins = np.unique(parameter, return_inverse=True)
    count = max(2, min(_MOST_BINS, len(result) // _PER_BIN))
    if len(levels) > count:
        bins = np.argsort(np.argsort(parameter, kind="stable")) * count // len(parameter)
    groups = len(np.unique(bins))
    total = float(np.var(result))
    if groups < 2 or len(result) <= groups or total == 0.0:
        return 0.0
    size = np.bincount(bins)
    present = size > 0
    mean = np.bincount(bins, result)[present] / size[present]
    within = 1.0 - float(np.average((mean - result.mean()) ** 2, weights=size[present])) / total
    return max(0.0, 1.0 - within * (len(result) - 1) / (len(result) - groups))


def separation(parameter: Array, chosen: NDArray[np.bool_]) -> float:
    """How far a parameter tells the chosen samples from the others: 0 not at all, 1 by itself.

    The largest distance of the two distributions (Kolmogorov and Smirnov), as in regional sensitivity analysis
    (Hornberger and Spear 1981).
    """
    result: Any = ks_2samp(parameter[chosen], parameter[~chosen], method="asymp")
    return float(result.statistic)


def trend(parameter: Array, result: Array) -> float:
    """Spearman's rank correlation: +1 if the result grows with the parameter, -1 if it falls."""
    if np.ptp(parameter) == 0.0 or np.ptp(result) == 0.0:
        return 0.0
    return float(np.corrcoef(rankdata(parameter), rankdata(result))[0, 1])
