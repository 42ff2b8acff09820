"""Where a drive is to end."""

import math
from dataclasses import dataclass, field
from typing import Any

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.validation.scenarios.tables import checked


@dataclass
class Goal:
    """The table `goal` of a scenario file: the run ends when the car's reference point is within all of these.

    Attributes:
        s: From, to, along the road's reference, in [m].
        l: From, to, to the left of it, in [m].
        time: From, to, in [s].
        speed: From, to, in [m/s].
        heading: From, to, relative to the road's direction, in [rad].
    """

    s: list[float] = field(default_factory=lambda: [-math.inf, math.inf])
    l: list[float] = field(default_factory=lambda: [-math.inf, math.inf])  # noqa: E741 (the paper's letter)
    time: list[float] = field(default_factory=lambda: [-math.inf, math.inf])
    speed: list[float] = field(default_factory=lambda: [-math.inf, math.inf])
    heading: list[float] = field(default_factory=lambda: [-math.inf, math.inf])

    def holds(self, state: VehicleState, s: float, l: float, heading: float) -> bool:  # noqa: E741
        """Whether it is reached.

        Args:
            state: Of the car.
            s, l: Where it is along and beside the path, in [m].
            heading: Its heading relative to the path, in [rad].
        """
        values = (s, l, state.time, math.hypot(state.v_x, state.v_y), math.remainder(heading, math.tau))
        limits = (self.s, self.l, self.time, self.speed, self.heading)
        return all(low <= value <= high for value, (low, high) in zip(values, limits, strict=True))


def goal(table: dict[str, Any] | None, path: ReferencePath) -> Goal | None:
    """The goal of a scenario file's table `goal`, in the frame of the path; None if there is none.

    Raises:
        InputError: Unknown key, or not two ascending numbers.
    """
    if table is None:
        return None
    values = checked(Goal, table, "goal")
    for key, limits in values.items():
        if len(limits) != 2 or not limits[0] <= limits[1]:
            raise InputError(f"goal.{key}", f"{limits}", "[from, to]")
    if not values:
        raise InputError("goal", "empty", "s, l, time, speed, heading")
    if "s" in values:
        values["s"] = [float(s) for s in path.station_of(values["s"])]
    return Goal(**values)
