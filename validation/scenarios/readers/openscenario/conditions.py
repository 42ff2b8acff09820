"""Conditions of OpenSCENARIO triggers."""

import math
import operator
import xml.etree.ElementTree as ET

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.openscenario.entities import Entity
from sidestep.validation.scenarios.readers.openscenario.positions import place
from sidestep.validation.scenarios.readers.openscenario.scene import Scene, gap
from sidestep.validation.scenarios.readers.safe_xml import number

_RULES = {
    "greaterThan": operator.gt, "greaterOrEqual": operator.ge, "lessThan": operator.lt, "lessOrEqual": operator.le,
    "equalTo": lambda a, b: math.isclose(a, b, abs_tol=1e-6),
    "notEqualTo": lambda a, b: not math.isclose(a, b, abs_tol=1e-6),
}  # fmt: skip
_TIME_SLACK = 1e-9
_KNOWN = (
    "RelativeDistance, TimeHeadway, TimeToCollision, Speed, RelativeSpeed, Acceleration, TraveledDistance, StandStill, "
    "ReachPosition, Distance"
)


def holds(element: ET.Element, scene: Scene) -> bool:
    """Whether a condition holds now, its edge and delay aside.

    Raises:
        InputError: A kind of condition that is not known.
    """
    by_value, by_entity = element.find("ByValueCondition"), element.find("ByEntityCondition")
    if by_value is not None and len(by_value):
        return _by_value(by_value[0], scene)
    if by_entity is not None:
        condition = by_entity.find("EntityCondition")
        names = [entity.get("entityRef", "") for entity in by_entity.findall("TriggeringEntities/EntityRef")]
        rule = by_entity.find("TriggeringEntities")
        join = all if rule is not None and rule.get("triggeringEntitiesRule") == "all" else any
        if condition is not None and len(condition) and names:
            return join([_by_entity(condition[0], _entity(name, scene), scene) for name in names])
    raise InputError(f"{scene.where}: condition {element.get('name')!r}", "is of no kind that is known here")


def _by_value(condition: ET.Element, scene: Scene) -> bool:
    if condition.tag == "SimulationTimeCondition":
        return _compared(condition, scene.time + _TIME_SLACK, scene)
    if condition.tag == "StoryboardElementStateCondition":
        state, asked = scene.states.get(condition.get("storyboardElementRef", "")), condition.get("state", "")
        if asked in ("completeState", "endTransition", "stopTransition"):
            return state == "complete"
        if asked in ("runningState", "startTransition"):
            return state == "running" or (asked == "startTransition" and state == "complete")
        return state is None
    raise InputError(f"{scene.where}: {condition.tag}", "is not known here", "SimulationTime, StoryboardElementState")


def _by_entity(condition: ET.Element, entity: Entity, scene: Scene) -> bool:
    free = condition.get("freespace") == "true"
    other = _entity(condition.get("entityRef", ""), scene) if condition.get("entityRef") else None
    along_road = condition.get("coordinateSystem", "entity") in ("road", "lane", "trajectory")
    match condition.tag:
        case "RelativeDistanceCondition" if other:
            return _compared(condition, _distance(condition, entity, other, scene, free, along_road), scene)
        case "TimeHeadwayCondition" if other:
            ahead = gap(entity, other, scene.road, free, along_road)
            return entity.speed > 1e-3 and _compared(condition, ahead / entity.speed, scene)
        case "TimeToCollisionCondition":
            return _time_to_collision(condition, entity, scene, free, along_road)
        case "SpeedCondition" | "RelativeSpeedCondition":
            return _compared(condition, entity.speed - (other.speed if other else 0.0), scene)
        case "AccelerationCondition":
            return _compared(condition, entity.acceleration, scene)
        case "TraveledDistanceCondition":
            return entity.travelled >= number(condition.get("value"), scene.where)
        case "StandStillCondition":
            return entity.stood >= number(condition.get("duration"), scene.where) - _TIME_SLACK
        case "ReachPositionCondition" | "DistanceCondition":
            return _near(condition, entity, scene)
    raise InputError(f"{scene.where}: {condition.tag}", "is not known here", _KNOWN)


def _distance(
    condition: ET.Element, entity: Entity, other: Entity, scene: Scene, free: bool, along_road: bool
) -> float:
    kind = condition.get("relativeDistanceType", "longitudinal")
    if kind == "longitudinal":
        return gap(entity, other, scene.road, free, along_road)
    if kind == "lateral":
        apart = abs(entity.t(scene.road) - other.t(scene.road))
        return max(apart - 0.5 * (entity.width + other.width), 0.0) if free else apart
    (x, y, _), (ox, oy, _) = entity.middle(scene.road), other.middle(scene.road)
    if free:
        raise InputError(f"{scene.where}: {condition.tag}", f"freespace with {kind!r}", "longitudinal, lateral")
    return math.hypot(ox - x, oy - y)


def _time_to_collision(condition: ET.Element, entity: Entity, scene: Scene, free: bool, along_road: bool) -> bool:
    target = condition.find("TimeToCollisionConditionTarget/EntityRef")
    if target is None:
        raise InputError(f"{scene.where}: {condition.tag}", "with a position", "an EntityRef")
    other = _entity(target.get("entityRef", ""), scene)
    closing = entity.speed - other.speed
    return closing > 1e-3 and _compared(condition, gap(entity, other, scene.road, free, along_road) / closing, scene)


def _near(condition: ET.Element, entity: Entity, scene: Scene) -> bool:
    position = condition.find("Position")
    if position is None:
        raise InputError(f"{scene.where}: {condition.tag}", "has no position")
    s, t, _ = place(position, scene)
    (x, y, _), (px, py, _) = entity.pose(scene.road), scene.road.pose(s, t)
    away = math.hypot(px - x, py - y)
    if condition.tag == "ReachPositionCondition":
        return away <= number(condition.get("tolerance"), scene.where)
    return _compared(condition, away, scene)


def _compared(condition: ET.Element, value: float, scene: Scene) -> bool:
    rule = condition.get("rule", "greaterThan")
    if rule not in _RULES:
        raise InputError(f"{scene.where}: {condition.tag} rule", f"{rule!r}", ", ".join(_RULES))
    return bool(_RULES[rule](value, number(condition.get("value"), scene.where)))


def _entity(name: str, scene: Scene) -> Entity:
    if name not in scene.entities or not scene.entities[name].placed:
        raise InputError(f"{scene.where}: entityRef", f"{name!r} is not in the scene", ", ".join(scene.entities))
    return scene.entities[name]
