"""Random scenes from a seed, as the text of a scenario file: any of them can be written out and run again."""

import math
from dataclasses import dataclass

import numpy as np

from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.vehicle.parameters import VehicleParameters

SPEEDS = (5.0, 25.0)
"""Of the car, in [m/s]."""
MAX_CURVATURE, ROAD_ACCELERATION = 0.02, 3.0
"""Of the road, in [1/m], less where following it alone would need more than this, in [m/s^2]."""
CONTACT_TIMES = (0.8, 8.0)
"""When the car would run into an obstacle if it went straight on, in [s]: some are too late to notice."""
DURATION = 25.0
"""Simulated time at most, in [s]: enough to stop comfortably from the highest speed."""

_GAP_SHARE, _WALL_SHARE, _MOVING_SHARE = 0.2, 0.08, 0.35


@dataclass(frozen=True)
class _Draw:
    """What the obstacles of one scene are drawn from."""

    random: np.random.Generator
    speed: float
    right: float
    left: float
    front: float

    def between(self, low: float, high: float) -> float:
        return round(float(self.random.uniform(low, high)), 3)

    def station(self, length: float, speed: float = 0.0) -> float:
        """Centre of a box that the front bumper meets at a random time."""
        return self.front + (self.speed - speed) * self.between(*CONTACT_TIMES) + length / 2.0


def random_scene(seed: int, vehicle: VehicleParameters | None = None) -> str:
    """The TOML text of scene `seed`: 2 to 6 boxes, standing, going ahead or oncoming, on a winding road.

    Args:
        seed: The scene is a pure function of it.
        vehicle: Whose bumper meets the boxes; the preset bmw-320i if None.
    """
    vehicle = vehicle or VehicleParameters.preset("bmw-320i")
    random = np.random.default_rng(seed)
    speed, left, right = (round(float(random.uniform(*limits)), 2) for limits in (SPEEDS, (3.0, 4.5), (3.0, 4.5)))
    draw = _Draw(random, speed, right, left, vehicle.front_extent)
    obstacles = _obstacles(draw, int(random.integers(2, 7)))
    start = draw.between(-0.5, 0.5)
    last = max(_passed_at(o, draw) for o in obstacles)
    lines = [
        f'name = "scene-{seed}"', f"speed = {speed}", f"duration = {DURATION}", "[road]",
        f"width_left = {left}", f"width_right = {right}", f"segments = [{_road(draw, last)}]",
        "[start]", f"l = {start}",
    ]  # fmt: skip
    for obstacle in obstacles:
        keys = ("s", "l", "length", "width", "heading", "speed")
        lines += ["[[obstacles]]", *(f"{key} = {round(getattr(obstacle, key), 3)}" for key in keys)]
    return "\n".join(lines) + "\n"


def _passed_at(obstacle: Obstacle, draw: _Draw) -> float:
    """Station at which the car, at its speed, has the obstacle behind it, in [m]."""
    distance = obstacle.s + obstacle.length / 2.0 + draw.front
    return distance * draw.speed / (draw.speed - obstacle.speed)


def _road(draw: _Draw, last: float) -> str:
    """A straight start, then bends joined by clothoids, until well behind the last obstacle."""
    most = min(MAX_CURVATURE, ROAD_ACCELERATION / draw.speed**2)
    straight, side = draw.between(10.0, 40.0), 1.0 if draw.random.random() < 0.5 else -1.0
    segments, laid, before = [f'{{ type = "line", length = {straight} }}'], straight, 0.0
    while laid < last + 4.0 * draw.speed:
        length, curvature = draw.between(20.0, 80.0), round(draw.between(0.0, 1.0) * most * side, 5)
        turn_in = round(max(10.0, draw.speed), 2)  # at least a second to turn in
        segments.append(
            f'{{ type = "clothoid", length = {turn_in}, curvature_start = {before}, curvature_end = {curvature} }}'
        )
        segments.append(f'{{ type = "arc", length = {length}, curvature = {curvature} }}')
        laid, before, side = laid + turn_in + length, curvature, -side  # never round in a circle
    return ", ".join(segments)


def _obstacles(draw: _Draw, count: int) -> list[Obstacle]:
    """`count` boxes, none of which ever drives into another."""
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        kind = draw.random.random()
        if kind < _WALL_SHARE / count:
            new = [_across(draw, draw.station(1.0), -draw.right, draw.left)]
        elif kind < _GAP_SHARE and count - len(obstacles) >= 2:
            new = _gap(draw)
        else:
            new = [_moving(draw) if draw.random.random() < _MOVING_SHARE else _standing(draw)]
        if not any(_meet(a, b) for a in new for b in obstacles):
            obstacles += new
    return obstacles


def _standing(draw: _Draw) -> Obstacle:
    length, width = draw.between(0.5, 6.0), draw.between(0.4, 2.2)
    heading = draw.between(-0.3, 0.3) if draw.random.random() < 0.5 else 0.0
    return Obstacle(draw.station(length), draw.between(-draw.right, draw.left), length, width, heading)


def _moving(draw: _Draw) -> Obstacle:
    """A car on its own side of the road: slower ahead, or oncoming."""
    length, width = draw.between(3.5, 6.0), draw.between(1.5, 2.0)
    if draw.random.random() < 0.6:
        speed, l = draw.between(0.1, 0.6) * draw.speed, draw.between(-draw.right + width / 2.0, 0.5)  # noqa: E741
    else:
        speed, l = -draw.between(0.2, 0.8) * draw.speed, draw.between(0.5, draw.left - width / 2.0)  # noqa: E741
    return Obstacle(draw.station(length, speed), l, length, width, 0.0, round(speed, 3))


def _gap(draw: _Draw) -> list[Obstacle]:
    """Two boxes from the road's edges inwards, with a gap that a car may fit through or not."""
    gap = draw.between(1.2, 4.0)
    right = draw.between(-draw.right + 0.2, draw.left - gap - 0.2)
    s = draw.station(1.0)
    return [_across(draw, s, -draw.right, right), _across(draw, s, right + gap, draw.left)]


def _across(draw: _Draw, s: float, right: float, left: float) -> Obstacle:
    return Obstacle(s, (right + left) / 2.0, 1.0, left - right)


def _meet(a: Obstacle, b: Obstacle) -> bool:
    """Whether two boxes, one of them moving, touch within the scene's time (by their circumscribed rectangles)."""
    if a.speed == b.speed or abs(a.l - b.l) > _reach(a, across=True) + _reach(b, across=True):
        return False
    reach = _reach(a) + _reach(b) + 1.0
    first, second = sorted(((b.s - a.s + side * reach) / (a.speed - b.speed)) for side in (-1.0, 1.0))
    return second > 0.0 and first < DURATION


def _reach(o: Obstacle, across: bool = False) -> float:
    c, s = math.cos(o.heading), abs(math.sin(o.heading))
    return (o.length * s + o.width * c if across else o.length * c + o.width * s) / 2.0
