"""Frequency response of the car to its steering, with the coherence that says where to trust it (ISO 7401)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal as processing

from sidestep.validation.manoeuvres.open_loop import PERIOD, Response

Array = NDArray[np.float64]

LEAST_COHERENCE = 0.95
"""Below, gain and phase are not to be read."""
SEGMENT = 10.0
"""Length of the segments that are averaged, in [s]; frequencies are its inverse apart."""


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Estimate H = S_xy / S_xx of Welch's averaged spectra, with coherence |S_xy|^2 / (S_xx S_yy).

    Attributes:
        frequency: Shape (n,), in [Hz].
        gain: |H|, in units of the signal per [rad].
        phase: Of H, continuous, in [rad].
        coherence: From 0 to 1.
    """

    frequency: Array
    gain: Array
    phase: Array
    coherence: Array

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Where the coherence is at least LEAST_COHERENCE."""
        return self.coherence >= LEAST_COHERENCE


def frequency_response(
    response: Response, signal: str = "yaw_rate", low: float = 0.2, high: float = 2.5
) -> FrequencyResponse:
    """Of `signal` to the realised road-wheel angle.

    Args:
        response: A sweep or random steering, a few segments long.
        signal: Its name.
        low, high: Range of frequency, in [Hz].
    """
    x, y, samples = response["steer_angle"], response[signal], round(SEGMENT / PERIOD)
    settings = {"fs": 1.0 / PERIOD, "nperseg": samples, "noverlap": 3 * samples // 4, "detrend": "constant"}
    frequency, across = processing.csd(x, y, **settings)
    _, power = processing.welch(x, **settings)
    _, coherence = processing.coherence(x, y, **settings)
    kept = (frequency >= low) & (frequency <= high)
    h = across[kept] / power[kept]
    return FrequencyResponse(frequency[kept], np.abs(h), np.unwrap(np.angle(h)), coherence[kept])
