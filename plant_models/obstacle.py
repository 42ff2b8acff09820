"""Obstacles as oriented boxes in the road frame."""

import math
from dataclasses import dataclass, fields, replace

from sidestep.plant_models.errors import InputError


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An oriented box, given by its centre at time 0 in road coordinates.

    Attributes:
        s, l: Arc length and lateral offset (left positive) of the centre, in [m].
        length, width: Size along and across its own heading, in [m].
        heading: Relative to the road's direction at s, in [rad].
        speed: Along the road at constant l, in [m/s].
        height: In [m]: a body that leans touches a tall one sooner. Only plants in three dimensions know it.
    """

    s: float
    l: float  # noqa: E741 (the paper's letter)
    length: float
    width: float
    heading: float = 0.0
    speed: float = 0.0
    height: float = 1.5

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise InputError(f"obstacle.{f.name}", f"{value!r} is not a finite number")
        for name in ("length", "width", "height"):
            if getattr(self, name) <= 0.0:
                raise InputError(f"obstacle.{name}", f"{getattr(self, name)}", "> 0")

    def at(self, time: float) -> "Obstacle":
        """The same box where it is after `time` seconds."""
        return replace(self, s=self.s + self.speed * time)
