"""Positions of OpenSCENARIO on the road of the car."""

import math
import xml.etree.ElementTree as ET

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.openscenario.entities import Entity
from sidestep.validation.scenarios.readers.openscenario.scene import Scene
from sidestep.validation.scenarios.readers.safe_xml import number


def lane_of(position: ET.Element, s: float, t: float, scene: Scene) -> int:
    """The lane of a position whose s and t are known: that which it names, or that which holds it."""
    if position.tag == "LanePosition":
        return int(number(position.get("laneId"), scene.where))
    if position.tag == "RelativeLanePosition":
        other = other_entity(position, scene)
        return beside(other.lane, int(number(position.get("dLane"), scene.where)))
    return scene.road.road.lane_of(min(max(s, 0.0), scene.road.road.length), t)


def beside(lane: int, by: int) -> int:
    """The lane a number of lanes further to the left; there is no lane 0."""
    other = lane + by
    return other + (1 if by > 0 else -1) if (other == 0 or (other > 0) != (lane > 0)) and by else other


def other_entity(element: ET.Element, scene: Scene) -> Entity:
    """The entity that an element refers to.

    Raises:
        InputError: It is not in the scene.
    """
    name = element.get("entityRef", "")
    if name not in scene.entities or not scene.entities[name].placed:
        raise InputError(f"{scene.where}: entityRef", f"{name!r} is not in the scene", ", ".join(scene.entities))
    return scene.entities[name]


def place(position: ET.Element, scene: Scene) -> tuple[float, float, float | None]:
    """S and t of a position, and the heading relative to the road if it gives one.

    Raises:
        InputError: Another road, or a kind of position that is not known here.
    """
    kind, where = position[0], f"{scene.where}: {position[0].tag}"
    if kind.get("roadId") not in (None, scene.road.road.id):
        raise InputError(
            f"{where} roadId", f"{kind.get('roadId')!r}: only the road of the car is looked at", scene.road.road.id
        )

    def of(name: str) -> float:
        return number(kind.get(name) or "0", f"{where} {name}")

    match kind.tag:
        case "LanePosition":
            s = of("s")
            t = scene.road.centre(int(of("laneId")), s) + of("offset")
        case "RelativeLanePosition":
            other = other_entity(kind, scene)
            s = other.s + of("ds") + of("dsLane")
            t = scene.road.centre(beside(other.lane, int(of("dLane"))), s) + of("offset")
        case "RoadPosition":
            s, t = of("s"), of("t")
        case "RelativeRoadPosition":
            other = other_entity(kind, scene)
            s, t = other.s + of("ds"), other.t(scene.road) + of("dt")
        case "WorldPosition":
            s, t = scene.road.road.locate(of("x"), of("y"))
            if kind.get("h"):
                return s, t, of("h") - scene.road.pose(s, t)[2]
        case "RelativeObjectPosition" | "RelativeWorldPosition":
            x, y, yaw = other_entity(kind, scene).pose(scene.road)
            turn = yaw if kind.tag == "RelativeObjectPosition" else 0.0
            c, d = math.cos(turn), math.sin(turn)
            s, t = scene.road.road.locate(x + c * of("dx") - d * of("dy"), y + d * of("dx") + c * of("dy"))
        case _:
            raise InputError(
                where,
                "is not known here",
                "Lane, RelativeLane, Road, RelativeRoad, World, RelativeObject, RelativeWorld",
            )
    return s, t, _heading(kind.find("Orientation"), s, t, scene)


def _heading(orientation: ET.Element | None, s: float, t: float, scene: Scene) -> float | None:
    if orientation is None or orientation.get("h") is None:
        return None
    heading = number(orientation.get("h"), f"{scene.where}: Orientation")
    return heading if orientation.get("type") == "relative" else heading - scene.road.pose(s, t)[2]
