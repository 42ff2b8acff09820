"""Theil's inequality: how far a prediction is off, and of what kind the error is.

With the measured a, the predicted p, their means, standard deviations s and correlation r,

    U          = rms(p - a) / (rms(p) + rms(a)):  0 perfect, 1 as bad as can be
    mean (p - a)^2 = (mean p - mean a)^2 + (s_p - s_a)^2 + 2 (1 - r) s_p s_a
                     bias                  variance        covariance

A share of bias or variance points to a parameter (an offset, a gain); a share of covariance to what the model has
not got at all: a lag, a nonlinearity, noise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Theil:
    """Theil's U and the shares of its three parts, which sum up to 1 (all 0 without an error)."""

    u: float
    bias: float
    variance: float
    covariance: float


def theil(measured: Array, predicted: Array) -> Theil:
    """Theil's inequality of two signals of shape (n,)."""
    error = predicted - measured
    mean_square = float(np.mean(error**2))
    if mean_square == 0.0:
        return Theil(0.0, 0.0, 0.0, 0.0)
    bias = float(error.mean()) ** 2
    variance = (float(predicted.std()) - float(measured.std())) ** 2
    size = float(np.sqrt(np.mean(predicted**2)) + np.sqrt(np.mean(measured**2)))
    shares = bias / mean_square, variance / mean_square, (mean_square - bias - variance) / mean_square
    return Theil(mean_square**0.5 / size, *shares)
