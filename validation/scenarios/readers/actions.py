"""Actions of OpenSCENARIO on entities, and the positions that they name."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.entities import SHAPES, Entity, Path, Transition, transition
from sidestep.validation.scenarios.readers.safe_xml import number

if TYPE_CHECKING:
    from sidestep.validation.scenarios.readers.storyboard import Scene

_HARMLESS = {
    "ControllerAction",
    "ActivateControllerAction",
    "AssignControllerAction",
    "VisibilityAction",
    "AppearanceAction",
}
_KNOWN = "Teleport, Speed, LaneChange, LaneOffset, LongitudinalDistance, FollowTrajectory"


def act(action: ET.Element, actors: list[str], scene: "Scene") -> list[Callable[[], bool]]:
    """Begin an action for its actors; what tells, for each, whether it is over.

    Raises:
        InputError: It would change the outcome and is not known here, or would move the car that is driven.
    """
    private = action if action.tag == "PrivateAction" else action.find("PrivateAction")
    if private is None or len(private) == 0:
        kind = next((child[0].tag for child in action if len(child)), "?")
        if kind in ("EnvironmentAction", "InfrastructureAction", "TrafficSignalAction"):
            scene.result.note(f"{kind}: left out")
            return [lambda: True]
        raise InputError(f"{scene.where}: action {action.get('name', '')!r}", f"{kind} is not known here", _KNOWN)
    return [_begin(private[0], scene.entities.get(name), name, scene) for name in actors]


def _begin(kind: ET.Element, entity: Entity | None, name: str, scene: "Scene") -> Callable[[], bool]:
    if entity is None:
        raise InputError(f"{scene.where}: entityRef", f"{name!r} is not declared", ", ".join(scene.entities))
    if kind.tag in _HARMLESS:
        if name != scene.ego:
            scene.result.note(f"{kind.tag} of {name}: left out")
        return lambda: True
    if name == scene.ego and scene.time > 0.0:
        raise InputError(
            f"{scene.where}: {kind.tag}", f"moves {name}, which is driven here", "actions at the beginning"
        )
    inner = kind if kind.tag == "TeleportAction" else kind[0] if len(kind) else kind
    if inner.tag not in _ACTIONS:
        raise InputError(f"{scene.where}: {inner.tag}", "is not known here", _KNOWN)
    return _ACTIONS[inner.tag](inner, entity, scene)


def _teleport(action: ET.Element, entity: Entity, scene: "Scene") -> Callable[[], bool]:
    position = action.find("Position")
    if position is None or len(position) == 0:
        raise InputError(f"{scene.where}: TeleportAction", "has no position")
    s, t, heading = place(position, scene)
    entity.lane = _lane_of(position[0], s, t, scene)
    entity.s, entity.offset = s, 0.0
    entity.offset = t - scene.road.centre(entity.lane, s)
    against = 0.0 if scene.road.road.direction(entity.lane) > 0 else math.pi
    entity.turn = 0.0 if heading is None else math.remainder(heading - against, math.tau)
    return lambda: True


def _lane_of(position: ET.Element, s: float, t: float, scene: "Scene") -> int:
    if position.tag == "LanePosition":
        return int(number(position.get("laneId"), scene.where))
    if position.tag == "RelativeLanePosition":
        other = _other(position, scene)
        return _beside(other.lane, int(number(position.get("dLane"), scene.where)))
    return scene.road.road.lane_of(min(max(s, 0.0), scene.road.road.length), t)


def _beside(lane: int, by: int) -> int:
    """The lane a number of lanes further to the left; there is no lane 0."""
    other = lane + by
    return other + (1 if by > 0 else -1) if (other == 0 or (other > 0) != (lane > 0)) and by else other


def _other(element: ET.Element, scene: "Scene") -> Entity:
    name = element.get("entityRef", "")
    if name not in scene.entities or not scene.entities[name].placed:
        raise InputError(f"{scene.where}: entityRef", f"{name!r} is not in the scene", ", ".join(scene.entities))
    return scene.entities[name]


def place(position: ET.Element, scene: "Scene") -> tuple[float, float, float | None]:
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
            other = _other(kind, scene)
            s = other.s + of("ds") + of("dsLane")
            t = scene.road.centre(_beside(other.lane, int(of("dLane"))), s) + of("offset")
        case "RoadPosition":
            s, t = of("s"), of("t")
        case "RelativeRoadPosition":
            other = _other(kind, scene)
            s, t = other.s + of("ds"), other.t(scene.road) + of("dt")
        case "WorldPosition":
            s, t = scene.road.road.locate(of("x"), of("y"))
            if kind.get("h"):
                return s, t, of("h") - scene.road.pose(s, t)[2]
        case "RelativeObjectPosition" | "RelativeWorldPosition":
            x, y, yaw = _other(kind, scene).pose(scene.road)
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


def _heading(orientation: ET.Element | None, s: float, t: float, scene: "Scene") -> float | None:
    if orientation is None or orientation.get("h") is None:
        return None
    heading = number(orientation.get("h"), f"{scene.where}: Orientation")
    return heading if orientation.get("type") == "relative" else heading - scene.road.pose(s, t)[2]


def _dynamics(element: ET.Element | None, scene: "Scene") -> tuple[str, str, float]:
    if element is None:
        raise InputError(scene.where, "an action has no dynamics")
    shape = element.get("dynamicsShape", "linear")
    if shape not in (*SHAPES, "step"):
        raise InputError(f"{scene.where}: dynamicsShape", f"{shape!r}", ", ".join((*SHAPES, "step")))
    return shape, element.get("dynamicsDimension", "time"), number(element.get("value") or "0", scene.where)


def _speed(action: ET.Element, entity: Entity, scene: "Scene") -> Callable[[], bool]:
    absolute, relative = (action.find(f"SpeedActionTarget/{kind}TargetSpeed") for kind in ("Absolute", "Relative"))
    if absolute is not None:
        target = number(absolute.get("value"), f"{scene.where}: speed")
    elif relative is not None:
        if relative.get("continuous") == "true":
            raise InputError(f"{scene.where}: RelativeTargetSpeed", "is continuous", 'continuous="false"')
        other, value = _other(relative, scene), number(relative.get("value"), f"{scene.where}: speed")
        target = other.speed * value if relative.get("speedTargetValueType") == "factor" else other.speed + value
    else:
        raise InputError(f"{scene.where}: SpeedAction", "has no target")
    shape, dimension, value = _dynamics(action.find("SpeedActionDynamics"), scene)
    change = transition(entity.speed, target, shape, dimension, value)
    if change.done:
        entity.speed, entity.longitudinal = target, None
        return lambda: True
    entity.longitudinal = change
    return lambda: entity.longitudinal is not change


def _shift(entity: Entity, change: Transition) -> Callable[[], bool]:
    if change.done:
        entity.offset, entity.lateral = change.end, None
        return lambda: True
    entity.lateral = change
    return lambda: entity.lateral is not change


def _lane_change(action: ET.Element, entity: Entity, scene: "Scene") -> Callable[[], bool]:
    relative, absolute = (action.find(f"LaneChangeTarget/{kind}TargetLane") for kind in ("Relative", "Absolute"))
    if relative is not None:
        other, by = _other(relative, scene), int(number(relative.get("value"), scene.where))
        lane = _beside(other.lane, by * scene.road.road.direction(other.lane))  # counted to the left of that car
    elif absolute is not None:
        lane = int(number(absolute.get("value"), scene.where))
    else:
        raise InputError(f"{scene.where}: LaneChangeAction", "has no target")
    entity.change_lane(scene.road, lane)
    end = number(action.get("targetLaneOffset") or "0", scene.where)
    return _shift(entity, transition(entity.offset, end, *_dynamics(action.find("LaneChangeActionDynamics"), scene)))


def _lane_offset(action: ET.Element, entity: Entity, scene: "Scene") -> Callable[[], bool]:
    if action.get("continuous") == "true":
        raise InputError(f"{scene.where}: LaneOffsetAction", "is continuous", 'continuous="false"')
    relative, absolute = (action.find(f"LaneOffsetTarget/{kind}TargetLaneOffset") for kind in ("Relative", "Absolute"))
    dynamics, end = action.find("LaneOffsetActionDynamics"), 0.0
    if relative is not None:
        end = _other(relative, scene).offset + number(relative.get("value"), scene.where)
    elif absolute is not None:
        end = number(absolute.get("value"), scene.where)
    shape, limit = "step", 0.0
    if dynamics is not None:
        shape, limit = dynamics.get("dynamicsShape", "step"), number(dynamics.get("maxLateralAcc") or "0", scene.where)
    if shape != "step" and limit <= 0.0:
        raise InputError(f"{scene.where}: LaneOffsetActionDynamics", "has no maxLateralAcc")
    if shape not in (*SHAPES, "step"):
        raise InputError(f"{scene.where}: dynamicsShape", f"{shape!r}", ", ".join((*SHAPES, "step")))
    # Largest second derivative of the shapes over unit time: pi^2 / 2, 6; a linear one has none, taken as sinusoidal.
    factor = 6.0 if shape == "cubic" else 0.5 * math.pi**2
    duration = math.sqrt(factor * abs(end - entity.offset) / limit) if shape != "step" else 0.0
    return _shift(entity, Transition(entity.offset, end, shape, duration))


def _distance(action: ET.Element, entity: Entity, scene: "Scene") -> Callable[[], bool]:
    if action.get("continuous") == "true" or scene.time > 0.0:
        raise InputError(
            f"{scene.where}: LongitudinalDistanceAction", "keeps a distance all along", "one at the beginning"
        )
    other = _other(action, scene)
    if action.get("timeGap") is not None:
        apart = number(action.get("timeGap"), scene.where) * entity.speed
    else:
        apart = number(action.get("distance"), scene.where)
    side = -1.0 if action.get("displacement") == "trailingReferencedEntity" else 1.0
    if action.get("freespace") == "true":
        lead, trail = (entity, other) if side > 0.0 else (other, entity)
        apart += trail.centre + 0.5 * trail.length - (lead.centre - 0.5 * lead.length)
    t = entity.t(scene.road)
    entity.s = other.s + side * apart * scene.road.road.direction(other.lane)
    entity.offset = t - scene.road.centre(entity.lane, entity.s)
    return lambda: True


def _trajectory(action: ET.Element, entity: Entity, scene: "Scene") -> Callable[[], bool]:
    where = f"{scene.where}: FollowTrajectoryAction"
    trajectory = action.find("TrajectoryRef/Trajectory")
    trajectory = action.find("Trajectory") if trajectory is None else trajectory
    line = None if trajectory is None else trajectory.find("Shape/Polyline")
    if line is None:
        raise InputError(where, "has no polyline", "Trajectory with a Polyline")
    timing = action.find("TimeReference/Timing")
    if timing is None:
        raise InputError(where, "has no timing", "Timing")
    scale, shift = (number(timing.get(name), where) for name in ("scale", "offset"))
    if timing.get("domainAbsoluteRelative") == "absolute":
        shift -= scene.time
    vertices = []
    for vertex in line.findall("Vertex"):
        position = vertex.find("Position")
        if position is None or vertex.get("time") is None:
            raise InputError(where, "has a vertex without position or time")
        vertices.append((number(vertex.get("time"), where) * scale + shift, *place(position, scene)))
    if len(vertices) < 2 or any(b[0] <= a[0] for a, b in pairwise(vertices)):
        raise InputError(where, "has less than two vertices, or times that do not ascend")
    scene.result.note(f"{entity.name} stands still where its trajectory ends")
    entity.longitudinal = entity.lateral = None
    path = entity.path = Path(vertices)
    return lambda: entity.path is not path


_ACTIONS: dict[str, Callable[[ET.Element, Entity, "Scene"], Callable[[], bool]]] = {
    "TeleportAction": _teleport, "SpeedAction": _speed, "LaneChangeAction": _lane_change,
    "LaneOffsetAction": _lane_offset, "LongitudinalDistanceAction": _distance, "FollowTrajectoryAction": _trajectory,
}  # fmt: skip
