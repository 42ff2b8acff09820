"""What the conditions and actions of a storyboard see, and distances in it."""

import math
from dataclasses import dataclass, field

from sidestep.validation.scenarios.readers.imported import Imported
from sidestep.validation.scenarios.readers.openscenario.entities import Entity
from sidestep.validation.scenarios.readers.openscenario.road_table import RoadTable


@dataclass
class Scene:
    """What conditions and actions see.

    Attributes:
        entities: By name.
        ego: Name of the car that is driven here.
        road: Where they are.
        time: In [s].
        states: "running" or "complete" of the storyboard's elements by name; not there before they run.
        result: Takes the notes.
        where: The file, for errors.
    """

    entities: dict[str, Entity]
    ego: str
    road: RoadTable
    result: Imported
    where: str
    time: float = 0.0
    states: dict[str, str] = field(default_factory=dict)


def gap(one: Entity, other: Entity, road: RoadTable, free: bool, along_road: bool) -> float:
    """Longitudinal distance of two entities, in [m].

    Args:
        one: In whose direction it is measured.
        other: To which.
        road: Where they are.
        free: Between their boxes rather than their origins.
        along_road: Along the road rather than straight ahead.
    """
    x, y, yaw = one.pose(road)
    ox, oy, other_yaw = other.pose(road)
    if along_road:
        ahead = (other.s - one.s) * road.road.direction(one.lane)
        turn = math.remainder(other_yaw - yaw - (road.pose(other.s, 0.0)[2] - road.pose(one.s, 0.0)[2]), math.tau)
    else:
        ahead, turn = (ox - x) * math.cos(yaw) + (oy - y) * math.sin(yaw), other_yaw - yaw
    if not free:
        return abs(ahead)
    half = 0.5 * (abs(other.length * math.cos(turn)) + abs(other.width * math.sin(turn)))
    middle = ahead + other.centre * math.cos(turn)
    front, rear = one.centre + 0.5 * one.length, one.centre - 0.5 * one.length
    if middle - half > front:
        return middle - half - front
    return max(rear - (middle + half), 0.0)
