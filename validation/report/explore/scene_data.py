"""What a page's view from above shows: cars, obstacles, corridor, plan and prediction at many moments, as JSON."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from sidestep.plant_models.signals import Status
from sidestep.validation.geometry import Array, car_boxes, obstacle_boxes, signed_clearance
from sidestep.validation.loop.recording import Recording
from sidestep.validation.report.compare.comparison import Line
from sidestep.validation.report.style import themed
from sidestep.validation.report.topview import driven_extent
from sidestep.validation.scenarios.scenario import Scenario

FAR = 1e6
MOST_FRAMES = 300
"""Moments that are kept at most: keeps a page of a long run small; the page draws what lies between them."""


def scene_data(scenario: Scenario, lines: Sequence[Line], start: float = 0.0) -> Markup:
    """JSON for `templates/scene.js`, safe within a script element.

    Args:
        scenario: Road and obstacles.
        lines: The cars on it; corridor and prediction are the first one's, if its recording has plans.
        start: Moment that is shown first, in [s].
    """
    first = lines[0].recording
    times = _times([line.recording for line in lines])
    boxes = [obstacle_boxes(scenario.path, obstacle, times) for obstacle in scenario.obstacles]
    data = {
        "road": _road(scenario, [line.recording for line in lines]),
        "times": np.round(times, 3).tolist(),
        "start": round(float(np.clip(start, times[0], times[-1])), 3),
        "obstacles": [[_flat(box) for box in (every if np.ptp(every, axis=0).any() else every[:1])] for every in boxes],
        "cars": [_car(scenario, line, times, boxes) for line in lines],
        "plans": [_plan(scenario, plan) for plan in _plans_at(first, times)],
    }
    return Markup(json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def _times(recordings: Sequence[Recording]) -> Array:
    """Of control periods where they are known: what is shown at a moment is what the controller knew then."""
    times = max((r.steps.get("time", np.zeros(0)) if r.plans else r["time"] for r in recordings), key=lambda t: t[-1])
    shown = np.arange(0, len(times), -(-len(times) // MOST_FRAMES))
    return np.unique(np.append(times[shown], times[-1]))


def _flat(points: Array) -> list[float]:
    """x, y, x, y, ... in centimetres' precision, as an SVG path takes it; a model that overflowed, far outside."""
    return (
        np.round(np.nan_to_num(np.asarray(points, dtype=float), nan=0.0, posinf=FAR, neginf=-FAR), 2).ravel().tolist()
    )


def _road(scenario: Scenario, recordings: Sequence[Recording]) -> dict[str, list[float]]:
    extents = np.array([driven_extent(recording) for recording in recordings])
    s = np.linspace(extents[:, 0].min(), extents[:, 1].max(), 400)
    path = scenario.path
    widths = path.widths(s)
    left, middle, right = (
        np.column_stack(path.to_cartesian(s, offset)) for offset in (widths[0], np.zeros_like(s), -widths[1])
    )
    return {"left": _flat(left), "middle": _flat(middle), "right": _flat(right)}


def _car(scenario: Scenario, line: Line, times: Array, boxes: Sequence[Array]) -> dict[str, Any]:
    """One car at the moments; after the end of its own run it stays where it came to."""
    recording, time = line.recording, line.recording["time"]

    def at(name: str, scale: float, digits: int) -> list[float]:
        values = np.unwrap(recording[name]) if name == "yaw" else recording[name]
        return np.round(scale * np.interp(times, time, values), digits).tolist()

    x, y, yaw = (
        np.interp(times, time, np.unwrap(v) if n == "yaw" else v) for n in ("x", "y", "yaw") for v in [recording[n]]
    )
    corners = car_boxes(scenario.vehicle, x, y, yaw)
    gaps = np.min([signed_clearance(corners, box) for box in boxes], axis=0) if boxes else None
    status = recording["status"][np.clip(np.searchsorted(time, times + 1e-9) - 1, 0, len(time) - 1)]
    return {
        "name": line.name,
        "colour": themed(line.colour),
        "outline": _flat(car_boxes(scenario.vehicle, 0.0, 0.0, 0.0)[0]),
        "driven": _flat(np.column_stack([recording["x"], recording["y"]])[::5]),
        "x": at("x", 1.0, 4),
        "y": at("y", 1.0, 4),
        "yaw": at("yaw", 1.0, 5),
        "speed": at("v_x", 1.0, 2),
        "steering": at("steer_angle", float(np.degrees(1.0)), 2),
        "lateral": at("lateral_acceleration", 1.0, 2),
        "gap": None if gaps is None else np.round(gaps, 3).tolist(),
        "status": [Status(int(value)).name.lower() for value in status],
    }


def _plans_at(recording: Recording, times: Array) -> list[Any]:
    """The plan that holds at each moment; none without plans."""
    if not recording.plans:
        return []
    made = recording.steps["time"][: len(recording.plans)]
    return [recording.plans[i] for i in np.clip(np.searchsorted(made, times + 1e-9) - 1, 0, len(made) - 1)]


def _plan(scenario: Scenario, plan: Any) -> dict[str, list[float]]:
    path = scenario.path
    widths = path.widths(plan.s)
    left, right = (np.clip(bound, -widths[1], widths[0]) for bound in (plan.left, plan.right))
    band = np.vstack([
        np.column_stack(path.to_cartesian(plan.s, left)),
        np.column_stack(path.to_cartesian(plan.s, right))[::-1],
    ])  # fmt: skip
    return {
        "corridor": _flat(band),
        "planned": _flat(np.column_stack(path.to_cartesian(plan.s, plan.l))),
        "predicted": _flat(np.column_stack(path.to_cartesian(plan.states_s, plan.states[:, 0]))),
    }
