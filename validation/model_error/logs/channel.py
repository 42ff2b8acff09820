"""One measured quantity as a log has it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Channel:
    """Values with their own times.

    Attributes:
        time: In [s], shape (n,).
        values: Shape (n,), in `unit`.
        unit: As the file says; empty if it does not.
    """

    time: NDArray[np.float64]
    values: NDArray[np.float64]
    unit: str = ""
