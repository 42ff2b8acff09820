"""How an obstacle moves that does not just go on at constant speed."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.reference_path import ReferencePath

Array = NDArray[np.float64]

_LONGEST, _SHORTEST, _FARTHEST = 1e4, 1e-6, 1e9  # s, s, m or s
_STEP = 0.05  # between the samples of a way given in the world: finer than that its road coordinates bend, in [s]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a box's centre over time, linear in between; it stays where it is before and after.

    Attributes:
        time: Ascending, shape (n,), in [s].
        s, l: In the road frame, shape (n,), in [m].
        heading: Relative to the road's direction there, continuous, shape (n,), in [rad].
        world: Rows of time [s], x, y [m] and yaw [rad] if it was given in the world, shape (m, 4); it is judged by it.
    """

    time: Array = field(repr=False)
    s: Array = field(repr=False)
    l: Array = field(repr=False)  # noqa: E741 (the paper's letter)
    heading: Array = field(repr=False)
    world: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in ("time", "s", "l", "heading"):
            values = np.array(getattr(self, name), dtype=np.float64).ravel()
            if len(values) != len(self.time) or len(values) == 0:
                raise InputError(f"trajectory.{name}", f"{len(values)} values", f"{max(len(self.time), 1)}, as of time")
            if not np.isfinite(values).all():
                raise InputError(f"trajectory.{name}", "holds a value that is not finite")
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if not (np.diff(self.time) > 0.0).all():
            raise InputError("trajectory.time", "does not ascend")

    @classmethod
    def in_world(cls, path: ReferencePath, time: ArrayLike, x: ArrayLike, y: ArrayLike, yaw: ArrayLike) -> "Trajectory":
        """A way given in the world, seen from the road as well; finely enough that both are the same within 1 mm.

        Args:
            path: The road.
            time: Ascending, shape (n,), in [s].
            x, y: Centre, shape (n,), in [m].
            yaw: Shape (n,), in [rad].
        """
        time, x, y = (np.array(values, dtype=np.float64).ravel() for values in (time, x, y))
        world = np.column_stack([time, x, y, np.unwrap(np.array(yaw, dtype=np.float64).ravel())])
        if len(time) == 0 or not (np.abs(world) < _FARTHEST).all() or not (np.diff(time) > _SHORTEST).all():
            raise InputError("trajectory", "times that do not ascend, or values that are no places or times")
        if time[-1] - time[0] > _LONGEST:
            raise InputError("trajectory", f"lasts {time[-1] - time[0]:g} s", f"up to {_LONGEST:g} s")
        count = max(1, int(np.ceil(round((time[-1] - time[0]) / _STEP, 6))))
        fine = np.union1d(np.linspace(time[0], time[-1], count + 1), time)
        poses = interpolated(world, fine)
        s, l, road = np.empty((3, len(fine)))  # noqa: E741
        near = None
        for i, (px, py, _) in enumerate(poses.T):
            s[i], l[i], road[i] = path.project(float(px), float(py), near)
            near = float(s[i])
        return cls(fine, s, l, np.unwrap(poses[2] - road), world)

    def to_plain(self) -> dict[str, list[Any]]:
        """As lists, for files."""
        values = {name: getattr(self, name).tolist() for name in ("time", "s", "l", "heading")}
        return values if self.world is None else {**values, "world": self.world.tolist()}

    @cached_property
    def _rates(self) -> Array:
        steps = np.diff(self.time)
        return np.stack([np.append(np.diff(values) / steps, 0.0) for values in (self.s, self.l)])

    def at(self, time: ArrayLike) -> Array:
        """s, l [m], heading [rad] and speed along the road [m/s] at some times [s], shape (4, ...)."""
        time = np.asarray(time, dtype=np.float64)
        row = np.searchsorted(self.time, time, side="right") - 1
        speed = np.where(row >= 0, self._rates[0][np.maximum(row, 0)], 0.0)
        places = [np.interp(time, self.time, values) for values in (self.s, self.l, self.heading)]
        return np.stack([*places, speed])


def interpolated(world: Array, time: ArrayLike) -> Array:
    """x, y [m] and yaw [rad] at some times [s], shape (3, n), of rows as in `Trajectory.world`."""
    time = np.asarray(time, dtype=np.float64)
    return np.stack([np.interp(time, world[:, 0], world[:, column]) for column in (1, 2, 3)])
