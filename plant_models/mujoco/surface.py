"""What the MuJoCo car drives on: tilt, patches of other friction, bumps."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.ranges import Range, check
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.vehicle.parameters import GRAVITY

_HIGHEST = 1e3  # of a bump, in [m]


@dataclass(frozen=True)
class FrictionPatch:
    """A rectangle of other friction, placed in the road frame as obstacles are.

    Attributes:
        s, l: Arc length and lateral offset (left positive) of the centre, in [m].
        length, width: Size along and across its own heading, in [m].
        friction: Instead of the plant's, as a factor on the tyre's peak.
        heading: Relative to the road's direction at s, in [rad].
    """

    s: Annotated[float, Range(-1e6, 1e6, "m")]
    l: Annotated[float, Range(-1e4, 1e4, "m")]  # noqa: E741 (the paper's letter)
    length: Annotated[float, Range(0.001, 1e4, "m")]
    width: Annotated[float, Range(0.001, 1e4, "m")]
    friction: Annotated[float, Range(0.001, 10.0)]
    heading: Annotated[float, Range(-100.0, 100.0, "rad")] = 0.0

    def __post_init__(self) -> None:
        check(self, "patch")


@dataclass(frozen=True)
class HeightField:
    """Heights of the road on a square grid, bilinear between; beyond it there is nothing to drive on.

    Attributes:
        heights: Rows along x, one per y, shape (n_y, n_x), in [m].
        spacing: Of the grid, in [m].
        x, y: Of the first point, in [m].
    """

    heights: NDArray[np.float64]
    spacing: Annotated[float, Range(0.001, 1e4, "m")]
    x: Annotated[float, Range(-1e6, 1e6, "m")] = 0.0
    y: Annotated[float, Range(-1e6, 1e6, "m")] = 0.0

    def __post_init__(self) -> None:
        if self.heights.ndim != 2 or min(self.heights.shape) < 2 or not np.isfinite(self.heights).all():
            raise InputError("heights", f"shape {self.heights.shape}", "a matrix of finite numbers, at least 2 x 2")
        if np.abs(self.heights).max() > _HIGHEST:
            raise InputError("heights", f"{np.abs(self.heights).max()} m", f"at most {_HIGHEST:g} m up or down")
        check(self, "heights")

    @classmethod
    def from_csv(cls, path: str | Path, spacing: float, x: float = 0.0, y: float = 0.0) -> "HeightField":
        """Read the heights from a file: a line per y, in it a number per x, with commas, in [m].

        Raises:
            InputError: The file holds no matrix, or a value is out of range.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # of an empty file
                heights = np.loadtxt(path, delimiter=",", ndmin=2)
        except (OSError, ValueError, UserWarning) as error:
            raise InputError(str(path), f"no matrix of heights ({error})", "rows along x, one per y, in [m]") from error
        return cls(heights, spacing, x, y)

    def at(self, x: float, y: float) -> float:
        """Height at a point, that of the edge beyond it, in [m]."""
        rows, columns = self.heights.shape
        j = min(max((x - self.x) / self.spacing, 0.0), columns - 1.0)
        i = min(max((y - self.y) / self.spacing, 0.0), rows - 1.0)
        i0, j0 = min(int(i), rows - 2), min(int(j), columns - 2)
        corners = self.heights[i0 : i0 + 2, j0 : j0 + 2]
        return float(np.array([i0 + 1 - i, i - i0]) @ corners @ np.array([j0 + 1 - j, j - j0]))


@dataclass(frozen=True)
class Surface:
    """The road's surface; by default a level plane of one friction.

    Attributes:
        grade, bank: Rise of the plane per metre along x and along y; it is gravity that is tilted.
        patches: Where they overlap, the last one counts.
        heights: Bumps on that plane; None for none.
    """

    grade: Annotated[float, Range(-1.0, 1.0)] = 0.0
    bank: Annotated[float, Range(-1.0, 1.0)] = 0.0
    patches: Sequence[FrictionPatch] = field(default=())
    heights: HeightField | None = None

    def __post_init__(self) -> None:
        check(self, "plant")

    @property
    def gravity(self) -> tuple[float, float, float]:
        """Along and normal to the tilted plane, in [m/s^2]."""
        scale = GRAVITY / math.sqrt(1.0 + self.grade**2 + self.bank**2)
        return -scale * self.grade, -scale * self.bank, -scale


def patch_table(patches: Sequence[FrictionPatch], path: ReferencePath | None) -> NDArray[np.float64]:
    """The patches in the plane as `contact_tyre.friction_at` takes them, shape (n, 7); `path` None for the x axis."""
    table = np.empty((len(patches), 7))
    for row, patch in zip(table, patches, strict=True):
        x, y = (patch.s, patch.l) if path is None else path.to_cartesian(patch.s, patch.l)
        yaw = patch.heading + (0.0 if path is None else float(path.heading(patch.s)))
        row[:] = x, y, math.cos(yaw), math.sin(yaw), patch.length / 2.0, patch.width / 2.0, patch.friction
    return table
