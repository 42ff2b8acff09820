"""CommonRoad scenarios (XML, 2018b, 2020a and later): lanelets, obstacles, the first planning problem."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.polyline import Polyline
from sidestep.validation.scenarios.readers.commonroad.lanelets import (
    Lanelet,
    Map,
    extended,
    lanelet_at,
    reference,
    route,
)
from sidestep.validation.scenarios.readers.commonroad.shapes import Box, box_of, pose_of, value_of
from sidestep.validation.scenarios.readers.imported import Imported
from sidestep.validation.scenarios.readers.safe_xml import number

KNOWN = ("2018a", "2018b", "2019", "2020a", "2021a", "2023a")
"""Versions whose elements these are."""
NEAR = 15.0
"""Obstacles that never come as close to the road's reference as this beside its widest half are left out, in [m]."""
SLOWEST = 3.0
"""To be held where the car starts slower than this and nothing says how fast it is to go, in [m/s]."""

_KNOWN_ELEMENTS = {
    "lanelet", "staticObstacle", "dynamicObstacle", "obstacle", "planningProblem", "location", "scenarioTags",
}  # fmt: skip


@dataclass(frozen=True)
class _Problem:
    """The start and what is known of the goal."""

    x: float
    y: float
    yaw: float
    speed: float
    yaw_rate: float
    slip: float
    goals: list[ET.Element]


def read_commonroad(root: ET.Element, file: Path) -> Imported:
    """The scenario of a file.

    Raises:
        InputError: It asks for what would change the outcome and cannot be done, or is incomplete.
    """
    result, step = Imported(), number(root.get("timeStepSize"), f"{file}: timeStepSize")
    version = root.get("commonRoadVersion", "")
    if version not in KNOWN:
        result.note(f"version {version!r} is not known here: read as {KNOWN[-1]}")
    for kind in sorted({element.tag for element in root} - _KNOWN_ELEMENTS):
        if kind in ("environmentObstacle", "phantomObstacle"):
            raise InputError(f"{file}: {kind}", "hides what is behind it, which no sensor here knows of", "none")
        result.note(f"{kind}: not looked at")
    lanes = _lanes(root, file)
    problem = _problem(root, file, result)
    rows = _way(lanes, problem, file, result)
    road = reference(lanes, extended(lanes, rows), (problem.x, problem.y), oncoming=True)
    line = shapely.LineString(road[:, :2])
    start = float(shapely.line_locate_point(line, shapely.Point(problem.x, problem.y)))
    obstacles, last = _obstacles(root, file, step, result, line, float(road[:, 2:].max()))
    goal, until = _goal(problem, lanes, line, step, result)
    result.tables = {
        "name": _name(root.get("benchmarkID") or file.stem),
        "description": f"CommonRoad {version} {root.get('benchmarkID', '')}".strip(),
        "speed": _speed(problem, goal, result),
        "duration": round(until or last or 20.0, 3),
        "road": {"points": np.round(road, 6).tolist()},
        "start": _start(problem, line, start),
        "obstacles": obstacles,
    }
    if goal:
        result.tables["goal"] = goal
    return result


def _name(text: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "_.-" else "_" for letter in text) or "commonroad"


def _lanes(root: ET.Element, file: Path) -> Map:
    lanes: Map = {}
    for element in root.findall("lanelet"):
        where = f"{file}: lanelet {element.get('id')}"
        left, right = (_points(element.find(name), f"{where} {name}") for name in ("leftBound", "rightBound"))
        lane = Lanelet(left, right, type=(element.findtext("laneletType") or "").strip())
        lane.successors, lane.predecessors = (
            [_key(e, where) for e in element.findall(n)] for n in ("successor", "predecessor")
        )
        for side in ("Left", "Right"):
            neighbour = element.find(f"adjacent{side}")
            if neighbour is not None:
                setattr(lane, f"{side.lower()}_of", (_key(neighbour, where), neighbour.get("drivingDir") == "same"))
        lanes[int(number(element.get("id"), where))] = lane
    if not lanes:
        raise InputError(str(file), "has no lanelet", "at least one")
    return lanes


def _key(element: ET.Element, where: str) -> int:
    return int(number(element.get("ref"), f"{where} {element.tag}"))


def _points(element: ET.Element | None, where: str) -> Any:
    found = [] if element is None else element.findall("point")
    points = np.array([[number(p.findtext("x"), where), number(p.findtext("y"), where)] for p in found])
    if len(points) < 2:
        raise InputError(where, f"{len(points)} points", "at least 2")
    return points


def _problem(root: ET.Element, file: Path, result: Imported) -> _Problem:
    problems = root.findall("planningProblem")
    if not problems:
        raise InputError(str(file), "has no planning problem: nobody is to drive", "a planningProblem")
    if len(problems) > 1:
        others = ", ".join(problem.get("id", "?") for problem in problems[1:])
        result.note(f"planning problem {problems[0].get('id')} is driven; {others} are not")
    where, state = f"{file}: planningProblem", problems[0].find("initialState")
    if state is None:
        raise InputError(where, "has no initialState")
    x, y, yaw = pose_of(state, where, result)
    speed, yaw_rate, slip = (value_of(state.find(name), where, 0.0) for name in ("velocity", "yawRate", "slipAngle"))
    if value_of(state.find("acceleration"), where, 0.0):
        result.note("the start's acceleration is left out: the plants start without one")
    goals = problems[0].findall("goalState") or problems[0].findall("goalRegion/state")
    return _Problem(x, y, yaw, speed, yaw_rate, slip, goals)


def _way(lanes: Map, problem: _Problem, file: Path, result: Imported) -> list[tuple[int, int]]:
    start = lanelet_at(lanes, problem.x, problem.y, problem.yaw)
    if start is None:
        raise InputError(f"{file}: planningProblem", "starts beside every lanelet", "a start on the road")
    if abs(math.remainder(lanes[start].heading_at(problem.x, problem.y) - problem.yaw, math.tau)) > 1.2:
        raise InputError(f"{file}: planningProblem", "starts across or against its lane", "a start along a lanelet")
    goals = set()
    for state in problem.goals:
        goals |= _goal_lanes(state, lanes)
    rows = route(lanes, start, goals) if goals else None
    if goals and rows is None:
        raise InputError(f"{file}: planningProblem", "no way over the lanelets to its goal")
    if not goals:
        result.note("no place is asked as the goal: the start's lane is followed")
    changes = sum(a != b for a, b in rows or [])
    if changes:
        result.note(f"{changes} changes of lane on the way to the goal: there the reference line goes over")
    return rows or [(start, start)]


def _goal_lanes(state: ET.Element, lanes: Map) -> set[int]:
    position = state.find("position")
    if position is None:
        return set()
    named = {int(number(ref.get("ref"), "goal: lanelet")) for ref in position.findall("lanelet")} & set(lanes)
    if named:
        return named
    outlines = [box_of(shape, "goal").outline for shape in position if shape.tag in ("rectangle", "circle", "polygon")]
    area = shapely.union_all(outlines)
    return {key for key, lane in lanes.items() if lane.polygon.intersection(area).area > 0.05}


def _goal(
    problem: _Problem, lanes: Map, line: shapely.LineString, step: float, result: Imported
) -> tuple[dict[str, Any], float]:
    """The table `goal` of the first goal state, and the time by which it is to be reached."""
    if not problem.goals:
        return {}, 0.0
    if len(problem.goals) > 1:
        result.note(f"the first of {len(problem.goals)} goal states is taken")
    state, goal = problem.goals[0], {}
    times = _interval(state.find("time"))
    until = times[1] * step if times else 0.0
    if times:
        goal["time"] = [round(value * step, 6) for value in times]
    if speeds := _interval(state.find("velocity")):
        goal["speed"] = speeds
    position = state.find("position")
    if position is not None:
        outlines = [lanes[key].polygon for key in _goal_lanes(state, lanes)]
        shapes = [s for s in position if s.tag in ("rectangle", "circle", "polygon")]
        outlines = [box_of(shape, "goal").outline for shape in shapes] or outlines
        if shapes:
            result.note("the goal's outline is taken as its bounding box along the road")
        if not outlines:
            raise InputError("goal: position", "names no lanelet of the file and no shape", "one of them")
        corners = shapely.points(np.vstack([shapely.get_coordinates(outline) for outline in outlines]))
        along = shapely.line_locate_point(line, corners)
        goal["s"] = [round(float(along.min()), 3), round(float(along.max()), 3)]
        away = float(shapely.distance(line, corners).max())
        goal["l"] = [-round(away, 3), round(away, 3)]
    if state.find("orientation") is not None:
        result.note("the goal's orientation is left out: the car drives along the road")
    return goal, until


def _interval(element: ET.Element | None) -> list[float] | None:
    if element is None:
        return None
    if (exact := element.findtext("exact")) is not None:
        return [number(exact, "goal"), number(exact, "goal")]
    return [number(element.findtext("intervalStart"), "goal"), number(element.findtext("intervalEnd"), "goal")]


def _speed(problem: _Problem, goal: dict[str, Any], result: Imported) -> float:
    if problem.speed >= SLOWEST:
        return round(problem.speed, 6)
    asked = sum(goal["speed"]) / 2.0 if "speed" in goal else 0.0
    speed = max(asked, SLOWEST)
    result.note(f"the car starts at {problem.speed:g} m/s: {speed:g} m/s are asked for")
    return speed


def _start(problem: _Problem, line: shapely.LineString, s: float) -> dict[str, float]:
    """In the frame of the reference line, as `traffic.placed` reads it."""
    given = Polyline(shapely.get_coordinates(line))
    foot, road = given.on(s)[0], float(given.heading(s)[0])
    chord = int(np.clip(np.searchsorted(given.stations, s, side="right") - 1, 0, len(given.points) - 2))
    direction = given.chord_headings[chord]
    across = (problem.y - foot[1]) * math.cos(direction) - (problem.x - foot[0]) * math.sin(direction)
    start = {
        "s": round(s, 6),
        "l": round(float(across), 6),
        "heading": round(math.remainder(problem.yaw - road, math.tau), 6),
    }
    start["speed"] = round(abs(problem.speed), 6)
    return start | {k: v for k, v in (("sideslip", problem.slip), ("yaw_rate", problem.yaw_rate)) if v}


def _obstacles(
    root: ET.Element, file: Path, step: float, result: Imported, line: shapely.LineString, half: float
) -> tuple[list[dict[str, Any]], float]:
    """Tables of the obstacles that come near the road, and the time at which the last one ends."""
    tables, last, away = [], 0.0, 0
    for element in [e for e in root if e.tag in ("obstacle", "staticObstacle", "dynamicObstacle")]:
        where = f"{file}: {element.tag} {element.get('id')}"
        if element.find("occupancySet") is not None or element.find("signalSeries") is not None:
            if element.find("occupancySet") is not None:
                raise InputError(where, "is a set of places it may be at, no motion", "a trajectory")
            result.note("signals of obstacles (lights, horn): not looked at")
        shape = element.find("shape")
        if shape is None or len(shape) == 0:
            raise InputError(where, "has no shape")
        if len(shape) > 1:
            result.note(f"obstacle {element.get('id')}: the first of its {len(shape)} shapes is taken")
        box, first = box_of(shape[0], where), element.find("initialState")
        states = [*([] if first is None else [first]), *element.findall("trajectory/state")]
        rows = np.array([_row(state, box, step, where, result) for state in states])
        if box.note:
            result.note(f"obstacle {element.get('id')}: {box.note}")
        if len(rows) == 0:
            raise InputError(where, "has no initialState")
        if float(shapely.distance(line, shapely.points(rows[:, 1:3])).min()) > half + NEAR:
            away += 1
            continue
        tables.append(_table(element, box, rows, step))
        last = max(last, float(rows[-1, 0]) if len(rows) > 1 else 0.0)
    if away:
        result.note(f"{away} obstacles never come within {NEAR:g} m of the road's edge: left out")
    return tables, last


def _row(state: ET.Element, box: Box, step: float, where: str, result: Imported) -> tuple[float, float, float, float]:
    x, y, yaw = pose_of(state, where, result)
    time = value_of(state.find("time"), where, 0.0) * step
    c, s = math.cos(yaw), math.sin(yaw)
    return time, x + c * box.x - s * box.y, y + s * box.x + c * box.y, yaw + box.yaw


def _table(element: ET.Element, box: Box, rows: Any, step: float) -> dict[str, Any]:
    kind = (element.findtext("type") or "").strip()
    motion = {
        "frame": "world",
        "t": np.round(rows[:, 0], 9).tolist(),
        "x": rows[:, 1].tolist(),
        "y": rows[:, 2].tolist(),
    }
    motion["heading"] = np.unwrap(rows[:, 3]).tolist()
    table: dict[str, Any] = {"length": box.length, "width": box.width, "trajectory": motion}
    if len(rows) > 1:
        if rows[0, 0] > 0.0:
            table["appears"] = round(float(rows[0, 0]), 9)
        table["vanishes"] = round(float(rows[-1, 0]) + 0.5 * step, 9)
    table["note"] = f"{kind} {element.get('id')}".strip() + (f": {box.note}" if box.note else "")
    return table
