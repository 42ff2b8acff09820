"""How wide the road is to each side of its reference path, station by station."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import Array

SPACING = 1.0
"""Of the entries of a table that varies, in [m]."""
DEFAULT = 4.0
"""Of a road of which nothing is said, in [m]."""


@dataclass(frozen=True, eq=False)
class Widths:
    """Distances from the path to the road's edges, as a table of constant spacing: a look-up costs the same anywhere.

    Attributes:
        table: Left, right, shape (n, 2), in [m], read-only; entry i holds at s = i * spacing, linear in between,
            constant outside (a closed path's table ends with its first entry).
        spacing: In [m].
    """

    table: Array = field(repr=False)
    spacing: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "table", np.array(self.table, dtype=np.float64))
        self.table.flags.writeable = False

    @classmethod
    def constant(cls, left: float = DEFAULT, right: float = DEFAULT) -> "Widths":
        """The same everywhere, in [m]."""
        return cls(np.array([[left, right], [left, right]]), 1.0)

    @classmethod
    def at_stations(cls, s: ArrayLike, left: ArrayLike, right: ArrayLike, length: float, closed: bool) -> "Widths":
        """Interpolated between stations of any spacing.

        Args:
            s: Ascending, shape (n,), in [m].
            left, right: Width at each, shape (n,), in [m].
            length: Of the path, in [m].
            closed: Whether the end of the path is its start.

        Raises:
            InputError: A width is not positive.
        """
        s, left, right = (np.asarray(values, dtype=np.float64) for values in (s, left, right))
        for name, values in (("left", left), ("right", right)):
            for i in np.flatnonzero(~((values > 0.0) & np.isfinite(values))).tolist():
                raise InputError(f"road.width_{name}", f"{values[i]} m at {s[i]:.6g} m", "> 0")
        if np.ptp(left) == 0.0 and np.ptp(right) == 0.0:
            return cls.constant(float(left[0]), float(right[0]))
        count = max(1, int(np.ceil(length / SPACING)))
        grid = np.linspace(0.0, length, count + 1)
        period = length if closed else None
        columns = [np.interp(grid, s, values, period=period) for values in (left, right)]
        return cls(np.column_stack(columns), length / count)

    @property
    def are_constant(self) -> bool:
        """Whether they are the same everywhere."""
        return bool(np.all(np.ptp(self.table, axis=0) == 0.0))

    @property
    def narrowest(self) -> tuple[float, float]:
        """Smallest width to the left and to the right, in [m]."""
        left, right = self.table.min(axis=0)
        return float(left), float(right)

    @property
    def widest(self) -> tuple[float, float]:
        """Largest width to the left and to the right, in [m]."""
        left, right = self.table.max(axis=0)
        return float(left), float(right)

    def at(self, s: ArrayLike, period: float = 0.0) -> tuple[Array, Array]:
        """Left and right at stations s [m], in [m]; `period` is the length of a closed path, else 0."""
        s = np.asarray(s, dtype=np.float64)
        if period > 0.0:
            s = np.remainder(s, period)
        place = np.clip(s / self.spacing, 0.0, len(self.table) - 1.0)
        row = np.minimum(place.astype(np.int64), len(self.table) - 2)
        share = (place - row)[..., None]
        values = (1.0 - share) * self.table[row] + share * self.table[row + 1]
        return values[..., 0], values[..., 1]


@kernel
def widths_at(table: Array, spacing: float, period: float, s: float) -> tuple[float, float]:
    """Left and right at one station, as `Widths.at`, for kernels: its table and spacing, the path's period."""
    if period > 0.0:
        s -= np.floor(s / period) * period
    place = min(max(s / spacing, 0.0), table.shape[0] - 1.0)
    row = min(int(place), table.shape[0] - 2)
    share = place - row
    left = (1.0 - share) * table[row, 0] + share * table[row + 1, 0]
    return left, (1.0 - share) * table[row, 1] + share * table[row + 1, 1]
