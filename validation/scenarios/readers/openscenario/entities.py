"""What moves in a storyboard: entities on a road, and the actions that change their speed and place."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from sidestep.validation.scenarios.readers.openscenario.road_table import RoadTable

SHAPES: dict[str, tuple[Callable[[float], float], float]] = {
    "linear": (lambda p: p, 1.0),
    "cubic": (lambda p: p * p * (3.0 - 2.0 * p), 1.5),
    "sinusoidal": (lambda p: 0.5 * (1.0 - math.cos(math.pi * p)), 0.5 * math.pi),
}
"""Transitions from 0 to 1, and their steepest slope."""


@dataclass
class Transition:
    """A value on its way from one number to another.

    Attributes:
        start, end: Of the value.
        shape: One of SHAPES, or "step".
        duration: In [s], or in [m] if `over_distance`; infinite if it never gets there.
        over_distance: Whether it goes by the way travelled.
    """

    start: float
    end: float
    shape: str
    duration: float
    over_distance: bool = False
    passed: float = 0.0

    def advance(self, dt: float, way: float) -> None:
        """Go on by a time [s] or way [m]."""
        self.passed += way if self.over_distance else dt

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return self.shape == "step" or self.start == self.end or self.passed >= self.duration - 1e-9

    @property
    def value(self) -> float:
        """Now."""
        if self.done:
            return self.end
        return self.start + SHAPES[self.shape][0](self.passed / self.duration) * (self.end - self.start)


@dataclass
class Path:
    """Vertices that are to be passed at given times: time [s], s, t [m] and heading relative to the road or None."""

    vertices: list[tuple[float, float, float, float | None]]
    passed: float = 0.0

    @property
    def done(self) -> bool:
        """Whether the last one is reached."""
        return self.passed >= self.vertices[-1][0] - 1e-9


@dataclass
class Entity:
    """Something on the road.

    Attributes:
        name, kind: Of the file.
        length, width: Of its box, in [m].
        centre: From its origin forward to the box's middle, in [m].
        s, lane, offset: Where its origin is: along the road, the lane, and beside its middle, in [m].
        turn: Heading relative to the lane's direction beyond that of its motion, in [rad].
        speed: In [m/s].
        lateral, longitudinal, path: Actions that run; None if there is none.
        track: Rows of time, x, y, yaw of its box's middle.
    """

    name: str
    kind: str
    length: float
    width: float
    centre: float
    s: float = math.nan
    lane: int = 0
    offset: float = 0.0
    turn: float = 0.0
    speed: float = 0.0
    lateral: Transition | None = None
    longitudinal: Transition | None = None
    path: Path | None = None
    slip: float = 0.0
    travelled: float = 0.0
    acceleration: float = 0.0
    stood: float = 0.0
    track: list[tuple[float, float, float, float]] = field(default_factory=list)

    @property
    def placed(self) -> bool:
        """Whether it is in the scene."""
        return math.isfinite(self.s)

    def t(self, road: RoadTable) -> float:
        """Lateral coordinate of its origin, in [m]."""
        return road.centre(self.lane, self.s) + self.offset

    def pose(self, road: RoadTable) -> tuple[float, float, float]:
        """x, y and yaw of its origin in the world."""
        x, y, heading = road.pose(self.s, self.t(road))
        against = 0.0 if road.road.direction(self.lane) > 0 else math.pi
        return x, y, heading + against + self.turn + self.slip

    def middle(self, road: RoadTable) -> tuple[float, float, float]:
        """x, y and yaw of its box's middle."""
        x, y, yaw = self.pose(road)
        return x + self.centre * math.cos(yaw), y + self.centre * math.sin(yaw), yaw

    def change_lane(self, road: RoadTable, lane: int) -> None:
        """Express where it is by another lane."""
        t, before = self.t(road), road.road.direction(self.lane)
        if road.road.direction(lane) != before:
            self.turn = math.remainder(self.turn + math.pi, math.tau)
        self.lane = lane
        self.offset = t - road.centre(lane, self.s)

    def advance(self, road: RoadTable, dt: float) -> None:
        """Go on for a time [s]."""
        if self.path is not None:
            self._follow(road, dt)
            return
        before = self.speed
        way = self.speed * dt
        if self.longitudinal is not None:
            self.longitudinal.advance(dt, way)
            self.speed = self.longitudinal.value
            if self.longitudinal.done:
                self.longitudinal = None
        way = 0.5 * (before + self.speed) * dt
        self.acceleration = (self.speed - before) / dt
        across = 0.0
        if self.lateral is not None:
            self.lateral.advance(dt, abs(way))
            across = self.lateral.value - self.offset
            self.offset = self.lateral.value
            if self.lateral.done:
                self.lateral = None
        direction = road.road.direction(self.lane) * (1.0 if math.cos(self.turn) >= 0.0 else -1.0)
        along = math.sqrt(max(way * way - across * across, 0.0)) * math.copysign(1.0, way)
        bend = 1.0 - road.curvature(self.s) * self.t(road)
        self.s += direction * along / bend if abs(math.cos(self.turn)) > 1e-6 else 0.0
        self.slip = math.atan2(across * direction, along) if abs(along) > 1e-9 else 0.0
        self._count(abs(way), dt)

    def _follow(self, road: RoadTable, dt: float) -> None:
        assert self.path is not None
        path, (s0, t0) = self.path, (self.s, self.t(road))
        path.passed += dt
        after = next((i for i, vertex in enumerate(path.vertices) if vertex[0] > path.passed), len(path.vertices) - 1)
        a, b = path.vertices[max(after - 1, 0)], path.vertices[after]
        share = min(max((path.passed - a[0]) / (b[0] - a[0]), 0.0), 1.0) if b[0] > a[0] else 1.0
        self.s = a[1] + share * (b[1] - a[1])
        self.offset = a[2] + share * (b[2] - a[2]) - road.centre(self.lane, self.s)
        ds, dl = self.s - s0, self.t(road) - t0
        way = math.hypot(ds, dl)
        against = 0.0 if road.road.direction(self.lane) > 0 else math.pi
        if a[3] is not None:
            self.turn, self.slip = math.remainder(a[3] - against, math.tau), 0.0
        elif way > 1e-6:
            self.turn, self.slip = math.remainder(math.atan2(dl, ds) - against, math.tau), 0.0
        self.speed = way / dt
        self._count(way, dt)
        if path.done:
            self.path, self.speed = None, 0.0

    def _count(self, way: float, dt: float) -> None:
        self.travelled += way
        self.stood = self.stood + dt if way < 1e-6 * dt else 0.0


def transition(start: float, end: float, shape: str, dimension: str, value: float) -> Transition:
    """A transition whose duration is a time, a way, or follows from its steepest slope.

    Args:
        start, end: Of the value.
        shape: One of SHAPES, or "step".
        dimension: "time", "distance" or "rate".
        value: In [s], [m], or the value's unit per second.
    """
    if shape == "step" or dimension in ("time", "distance"):
        return Transition(start, end, shape, value, dimension == "distance")
    slope = SHAPES[shape][1] * abs(end - start)
    return Transition(start, end, shape, slope / value if value > 0.0 else math.inf)
