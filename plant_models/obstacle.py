"""Obstacles as oriented boxes in the road frame."""

from dataclasses import dataclass, replace
from typing import Annotated

from sidestep.plant_models.ranges import Range, check


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

    s: Annotated[float, Range(-1e6, 1e6, "m")]
    l: Annotated[float, Range(-1e4, 1e4, "m")]  # noqa: E741 (the paper's letter)
    length: Annotated[float, Range(0.001, 1e4, "m")]
    width: Annotated[float, Range(0.001, 1e4, "m")]
    heading: Annotated[float, Range(-100.0, 100.0, "rad")] = 0.0
    speed: Annotated[float, Range(-150.0, 150.0, "m/s")] = 0.0
    height: Annotated[float, Range(0.001, 100.0, "m")] = 1.5

    def __post_init__(self) -> None:
        check(self, "obstacle")

    def at(self, time: float) -> "Obstacle":
        """The same box where it is after `time` seconds."""
        return replace(self, s=self.s + self.speed * time)
