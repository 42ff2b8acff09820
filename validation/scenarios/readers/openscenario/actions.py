"""Actions of OpenSCENARIO on entities."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from itertools import pairwise

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.openscenario.entities import SHAPES, Entity, Path, Transition, transition
from sidestep.validation.scenarios.readers.openscenario.positions import beside, lane_of, other_entity, place
from sidestep.validation.scenarios.readers.openscenario.scene import Scene
from sidestep.validation.scenarios.readers.safe_xml import number

_HARMLESS = {
    "ControllerAction",
    "ActivateControllerAction",
    "AssignControllerAction",
    "VisibilityAction",
    "AppearanceAction",
}
_KNOWN = "Teleport, Speed, LaneChange, LaneOffset, LongitudinalDistance, FollowTrajectory"


def act(action: ET.Element, actors: list[str], scene: Scene) -> list[Callable[[], bool]]:
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


def _begin(kind: ET.Element, entity: Entity | None, name: str, scene: Scene) -> Callable[[], bool]:
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


def _teleport(action: ET.Element, entity: Entity, scene: Scene) -> Callable[[], bool]:
    position = action.find("Position")
    if position is None or len(position) == 0:
        raise InputError(f"{scene.where}: TeleportAction", "has no position")
    s, t, heading = place(position, scene)
    entity.lane = lane_of(position[0], s, t, scene)
    entity.s, entity.offset = s, 0.0
    entity.offset = t - scene.road.centre(entity.lane, s)
    against = 0.0 if scene.road.road.direction(entity.lane) > 0 else math.pi
    entity.turn = 0.0 if heading is None else math.remainder(heading - against, math.tau)
    return lambda: True


def _dynamics(element: ET.Element | None, scene: Scene) -> tuple[str, str, float]:
    if element is None:
        raise InputError(scene.where, "an action has no dynamics")
    shape = element.get("dynamicsShape", "linear")
    if shape not in (*SHAPES, "step"):
        raise InputError(f"{scene.where}: dynamicsShape", f"{shape!r}", ", ".join((*SHAPES, "step")))
    return shape, element.get("dynamicsDimension", "time"), number(element.get("value") or "0", scene.where)


def _speed(action: ET.Element, entity: Entity, scene: Scene) -> Callable[[], bool]:
    absolute, relative = (action.find(f"SpeedActionTarget/{kind}TargetSpeed") for kind in ("Absolute", "Relative"))
    if absolute is not None:
        target = number(absolute.get("value"), f"{scene.where}: speed")
    elif relative is not None:
        if relative.get("continuous") == "true":
            raise InputError(f"{scene.where}: RelativeTargetSpeed", "is continuous", 'continuous="false"')
        other, value = other_entity(relative, scene), number(relative.get("value"), f"{scene.where}: speed")
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


def _lane_change(action: ET.Element, entity: Entity, scene: Scene) -> Callable[[], bool]:
    relative, absolute = (action.find(f"LaneChangeTarget/{kind}TargetLane") for kind in ("Relative", "Absolute"))
    if relative is not None:
        other, by = other_entity(relative, scene), int(number(relative.get("value"), scene.where))
        lane = beside(other.lane, by * scene.road.road.direction(other.lane))  # counted to the left of that car
    elif absolute is not None:
        lane = int(number(absolute.get("value"), scene.where))
    else:
        raise InputError(f"{scene.where}: LaneChangeAction", "has no target")
    entity.change_lane(scene.road, lane)
    end = number(action.get("targetLaneOffset") or "0", scene.where)
    return _shift(entity, transition(entity.offset, end, *_dynamics(action.find("LaneChangeActionDynamics"), scene)))


def _lane_offset(action: ET.Element, entity: Entity, scene: Scene) -> Callable[[], bool]:
    if action.get("continuous") == "true":
        raise InputError(f"{scene.where}: LaneOffsetAction", "is continuous", 'continuous="false"')
    relative, absolute = (action.find(f"LaneOffsetTarget/{kind}TargetLaneOffset") for kind in ("Relative", "Absolute"))
    dynamics, end = action.find("LaneOffsetActionDynamics"), 0.0
    if relative is not None:
        end = other_entity(relative, scene).offset + number(relative.get("value"), scene.where)
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


def _distance(action: ET.Element, entity: Entity, scene: Scene) -> Callable[[], bool]:
    if action.get("continuous") == "true" or scene.time > 0.0:
        raise InputError(
            f"{scene.where}: LongitudinalDistanceAction", "keeps a distance all along", "one at the beginning"
        )
    other = other_entity(action, scene)
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


def _trajectory(action: ET.Element, entity: Entity, scene: Scene) -> Callable[[], bool]:
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


_ACTIONS: dict[str, Callable[[ET.Element, Entity, Scene], Callable[[], bool]]] = {
    "TeleportAction": _teleport, "SpeedAction": _speed, "LaneChangeAction": _lane_change,
    "LaneOffsetAction": _lane_offset, "LongitudinalDistanceAction": _distance, "FollowTrajectoryAction": _trajectory,
}  # fmt: skip
