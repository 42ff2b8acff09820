"""An OpenSCENARIO storyboard, stepped through: triggers, events and their actions on entities."""

import xml.etree.ElementTree as ET
from collections.abc import Callable

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.openscenario.actions import act
from sidestep.validation.scenarios.readers.openscenario.conditions import holds
from sidestep.validation.scenarios.readers.openscenario.scene import Scene
from sidestep.validation.scenarios.readers.safe_xml import number

STEP = 0.05
"""Of the storyboard, in [s]."""
LONGEST = 600.0
"""After which a storyboard without an end is cut, in [s]."""


class _Trigger:
    """Any of its groups, in which all conditions hold."""

    def __init__(self, element: ET.Element | None) -> None:
        groups = [] if element is None else element.findall("ConditionGroup")
        self._groups = [[_Condition(condition) for condition in group.findall("Condition")] for group in groups]
        self.given = element is not None

    def fires(self, scene: Scene) -> bool:
        return any([all([condition.fires(scene) for condition in group]) for group in self._groups])


class _Condition:
    """One condition with its edge and delay."""

    def __init__(self, element: ET.Element) -> None:
        self._element, self._edge = element, element.get("conditionEdge", "none")
        self._delay = round(number(element.get("delay") or "0", "Condition delay") / STEP)
        if self._delay < 0:
            raise InputError("Condition delay", f"{element.get('delay')}", ">= 0 s")
        self._seen: list[bool] = []

    def fires(self, scene: Scene) -> bool:
        self._seen.append(holds(self._element, scene))
        now, before = (
            self._seen[i] if i >= 0 else None for i in (len(self._seen) - 1 - self._delay - k for k in (0, 1))
        )
        if now is None:
            return False
        if self._edge in ("rising", "risingOrFalling") and before is not None and now and not before:
            return True
        if self._edge in ("falling", "risingOrFalling") and before is not None and before and not now:
            return True
        if self._edge == "rising" and before is None:
            return now and self._delay == 0  # true from the beginning counts as having risen
        return now if self._edge == "none" else False


class _Event:
    def __init__(self, element: ET.Element, actors: list[str], prefix: str) -> None:
        self.name, self._actors = element.get("name", prefix), actors
        self._start = _Trigger(element.find("StartTrigger"))
        self._actions = element.findall("Action")
        self._left = int(number(element.get("maximumExecutionCount") or "1", self.name))
        self._running: dict[str, list[Callable[[], bool]]] = {}

    def step(self, scene: Scene) -> None:
        if self._running:
            for name, checks in list(self._running.items()):
                if all([check() for check in checks]):
                    scene.states[name] = "complete"
                    del self._running[name]
            if not self._running:
                scene.states[self.name] = "complete"
        fires = self._start.fires(scene) if self._start.given else True
        if not self._running and self._left > 0 and fires:
            self._left -= 1
            scene.states[self.name] = "running"
            for action in self._actions:
                name = action.get("name", "")
                self._running[name] = act(action, self._actors, scene)
                scene.states[name] = "running"


class _Group:
    """A manoeuvre group of an act."""

    def __init__(self, element: ET.Element) -> None:
        self.name = element.get("name", "")
        actors = [entity.get("entityRef", "") for entity in element.findall("Actors/EntityRef")]
        if element.find("CatalogReference") is not None:
            raise InputError("ManeuverGroup", "takes its manoeuvre from a catalogue", "a Maneuver in the file")
        if element.find("Actors") is not None and element.find("Actors").get("selectTriggeringEntities") == "true":  # pyright: ignore[reportOptionalMemberAccess]
            raise InputError("Actors", "are selected by what triggers", "EntityRef")
        self.events = [
            _Event(event, actors, self.name)
            for manoeuvre in element.findall("Maneuver")
            for event in manoeuvre.findall("Event")
        ]


class _Act:
    def __init__(self, element: ET.Element) -> None:
        self.name, self._start = element.get("name", ""), _Trigger(element.find("StartTrigger"))
        self._stop = _Trigger(element.find("StopTrigger"))
        self._groups = [_Group(group) for group in element.findall("ManeuverGroup")]
        self._runs = self._over = False

    def step(self, scene: Scene) -> None:
        if not self._runs and (not self._start.given or self._start.fires(scene)):
            self._runs, scene.states[self.name] = True, "running"
        if self._runs and not self._over and self._stop.given and self._stop.fires(scene):
            self._over, scene.states[self.name] = True, "complete"
        if self._runs and not self._over:
            for group in self._groups:
                for event in group.events:
                    event.step(scene)


class Storyboard:
    """Runs from its beginning; `step` after `step`."""

    def __init__(self, element: ET.Element, scene: Scene) -> None:
        self.scene = scene
        self._acts = [_Act(act_) for act_ in element.findall("Story/Act")]
        self._stop = _Trigger(element.find("StopTrigger"))
        for action in element.findall("Init/Actions/GlobalAction"):
            kind = action[0].tag if len(action) else "?"
            scene.result.note(f"{kind}: left out")
        for private in element.findall("Init/Actions/Private"):
            for action in private.findall("PrivateAction"):
                act(action, [private.get("entityRef", "")], scene)

    def run(self) -> float:
        """Step until the stop trigger fires; the time at which it did, in [s]."""
        steps = round(LONGEST / STEP)
        for k in range(steps + 1):
            scene = self.scene
            scene.time = k * STEP
            for entity in scene.entities.values():
                if entity.placed:
                    entity.track.append((scene.time, *entity.middle(scene.road)))
            if self._stop.given and self._stop.fires(scene):
                return max(scene.time, STEP)
            for act_ in self._acts:
                act_.step(scene)
            for entity in scene.entities.values():
                if entity.placed:
                    entity.advance(scene.road, STEP)
        self.scene.result.note(f"the storyboard does not end by itself: cut after {LONGEST:g} s")
        return LONGEST
