"""A road looked up fast: reference line and lane middles on a fine grid, for stepping through a storyboard."""

import math

import numpy as np

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.openscenario.opendrive import Road

_STEP = 0.5  # of the grid, in [m]


class RoadTable:
    """Poses on one road by linear interpolation on a grid; straight on beyond its ends."""

    def __init__(self, road: Road) -> None:
        self.road = road
        self._count = max(2, math.ceil(road.length / _STEP) + 1)
        self._grid = np.linspace(0.0, road.length, self._count)
        self._step = road.length / (self._count - 1)
        x, y, heading = road.reference(self._grid)
        heading = np.unwrap(heading)
        self._x, self._y, self._heading = x.tolist(), y.tolist(), heading.tolist()
        self._curvature = np.gradient(heading, self._step).tolist()
        self._centres: dict[int, list[float]] = {}

    def pose(self, s: float, t: float) -> tuple[float, float, float]:
        """x, y and the reference line's heading at s, t."""
        inside = min(max(s, 0.0), self.road.length)
        heading = self._at(self._heading, inside)
        beyond = s - inside
        x = self._at(self._x, inside) - t * math.sin(heading) + beyond * math.cos(heading)
        return x, self._at(self._y, inside) + t * math.cos(heading) + beyond * math.sin(heading), heading

    def curvature(self, s: float) -> float:
        """Of the reference line, in [1/m]."""
        return self._at(self._curvature, min(max(s, 0.0), self.road.length))

    def centre(self, lane: int, s: float) -> float:
        """Middle of a lane as t, in [m].

        Raises:
            InputError: There is no such lane somewhere on the road.
        """
        if lane not in self._centres:
            self._centres[lane] = self._lane(lane)
        return self._at(self._centres[lane], min(max(s, 0.0), self.road.length))

    def _lane(self, lane: int) -> list[float]:
        values = np.full(self._count, np.nan)
        ends = [start for start, _ in self.road.sections[1:]] + [math.inf]
        for (start, lanes), end in zip(self.road.sections, ends, strict=True):
            part = (self._grid >= start) & (self._grid < end)
            if lane in lanes or lane == 0:
                values[part] = self.road.centre(lane, self._grid[part])
        known = np.flatnonzero(np.isfinite(values))
        if len(known) == 0:
            known_lanes = sorted({number for _, lanes in self.road.sections for number in lanes})
            raise InputError(f"road {self.road.id}", f"no lane {lane}", ", ".join(map(str, known_lanes)))
        return np.interp(np.arange(self._count), known, values[known]).tolist()

    def _at(self, values: list[float], s: float) -> float:
        place = s / self._step
        row = min(int(place), self._count - 2)
        return values[row] + (place - row) * (values[row + 1] - values[row])
