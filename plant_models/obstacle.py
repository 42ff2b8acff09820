"""Obstacles as oriented boxes in the road frame."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sidestep.plant_models.ranges import Range, check
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.trajectory import Trajectory, interpolated

FOREVER = 1e9
"""A time after every drive, in [s]."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An oriented box, given by its centre at time 0 in road coordinates.

    Attributes:
        s, l: Arc length and lateral offset (left positive) of the centre, in [m].
        length, width: Size along and across its own heading, in [m].
        heading: Relative to the road's direction at s, in [rad].
        speed: Along the road at constant l, in [m/s].
        height: In [m]: a body that leans touches a tall one sooner. Only plants in three dimensions know it.
        appears, vanishes: When it comes and goes, in [s]; before and after it is not there.
        trajectory: How it moves instead of at constant speed; s, l, heading and speed are those at time 0.
    """

    s: Annotated[float, Range(-1e6, 1e6, "m")]
    l: Annotated[float, Range(-1e4, 1e4, "m")]  # noqa: E741 (the paper's letter)
    length: Annotated[float, Range(0.001, 1e4, "m")]
    width: Annotated[float, Range(0.001, 1e4, "m")]
    heading: Annotated[float, Range(-100.0, 100.0, "rad")] = 0.0
    speed: Annotated[float, Range(-150.0, 150.0, "m/s")] = 0.0
    height: Annotated[float, Range(0.001, 100.0, "m")] = 1.5
    appears: Annotated[float, Range(-FOREVER, FOREVER, "s")] = 0.0
    vanishes: Annotated[float, Range(-FOREVER, FOREVER, "s")] = FOREVER
    trajectory: Trajectory | None = None

    def __post_init__(self) -> None:
        check(self, "obstacle")

    @classmethod
    def along(
        cls, trajectory: Trajectory, length: float, width: float, height: float = 1.5,
        appears: float = 0.0, vanishes: float = FOREVER,
    ) -> "Obstacle":  # fmt: skip
        """A box that follows a trajectory."""
        s, l, heading, speed = (float(value) for value in trajectory.at(0.0))  # noqa: E741
        return cls(s, l, length, width, heading, speed, height, appears, vanishes, trajectory)

    def to_plain(self) -> dict[str, Any]:
        """As numbers, lists and dictionaries, for files."""
        values: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        return values | {"trajectory": self.trajectory and self.trajectory.to_plain()}

    @classmethod
    def from_plain(cls, values: Mapping[str, Any]) -> "Obstacle":
        """From what `to_plain` gave."""
        way = values["trajectory"]
        return cls(**{**values, "trajectory": way and Trajectory(**{k: np.array(v) for k, v in way.items()})})

    @property
    def moves(self) -> bool:
        """Whether it ever is elsewhere than at time 0."""
        return self.speed != 0.0 or self.trajectory is not None or not self.is_there(0.0) or self.vanishes != FOREVER

    def is_there(self, time: ArrayLike) -> NDArray[np.bool_]:
        """Whether it has appeared and not vanished at some times [s]."""
        time = np.asarray(time, dtype=np.float64)
        return (time >= self.appears) & (time < self.vanishes)

    def track(self, time: ArrayLike) -> NDArray[np.float64]:
        """s, l [m], heading [rad] and speed along the road [m/s] at some times [s], shape (4, ...)."""
        time = np.asarray(time, dtype=np.float64)
        if self.trajectory is not None:
            return self.trajectory.at(time)
        same = np.ones_like(time)
        return np.stack([self.s + self.speed * time, self.l * same, self.heading * same, self.speed * same])

    def pose(self, path: ReferencePath | None, time: float) -> tuple[float, float, float]:
        """x, y [m] and yaw [rad] of its centre in the world at a time [s].

        Args:
            path: The road; None for the x axis.
            time: In [s].
        """
        if self.trajectory is not None and self.trajectory.world is not None:
            x, y, yaw = (float(value) for value in interpolated(self.trajectory.world, time))
            return x, y, yaw
        s, l, heading, _ = (float(value) for value in self.track(time))  # noqa: E741
        return (s, l, heading) if path is None else (*path.to_cartesian(s, l), path.heading(s) + heading)

    def at(self, time: float) -> "Obstacle":
        """The same box as it is after `time` seconds, going on at the speed that it has there."""
        s, l, heading, speed = (float(value) for value in self.track(time))  # noqa: E741
        return replace(self, s=s, l=l, heading=heading, speed=speed, trajectory=None)
