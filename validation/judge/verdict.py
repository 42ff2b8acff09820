"""Acceptance from exact oriented boxes in the plant's own state.

Nothing of the controller is used here: the car is its outline at the plant's pose, obstacles are their boxes
carried into the world by the reference path, and shapely measures between them.
"""

from dataclasses import dataclass

import numpy as np

from sidestep.validation.judge.geometry import Array, car_boxes, edge_clearance, obstacle_boxes, signed_clearance
from sidestep.validation.loop.recording import End, Recording
from sidestep.validation.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Judgement:
    """What became of a run.

    Attributes:
        label: The first of these that holds. "plant invalid", "controller error", "bus error": the run broke
            off there. "collision": the outlines overlap in some sample, or the plant's own geometry touched (a
            body that rolls reaches over its outline). "corridor violation": a corner is over the road's edge.
            "interrupted": from outside. "infeasible, handled": in some steps the controller had no feasible
            problem, fell back and came through. "ok".
        min_clearance: Smallest signed distance of the car to an obstacle, in [m], negative by the depth of
            penetration; None without obstacles.
        obstacle: Index of that obstacle.
        time, s: When and at which station of the car that was, in [s] and [m].
        min_edge_clearance: Smallest signed distance of a corner to the road's edges, in [m].
    """

    label: str
    min_clearance: float | None
    obstacle: int | None
    time: float | None
    s: float | None
    min_edge_clearance: float

    @property
    def passed(self) -> bool:
        """Whether the car drove its time, or to the road's end, or stopped by itself, without touching anything."""
        return self.label in ("ok", "infeasible, handled")


def judge(recording: Recording, scenario: Scenario) -> Judgement:
    """Judge every sample of a run (10 ms apart at most), moving obstacles where they are at that time."""
    time, s, path = recording["time"], recording["s"], scenario.path
    car = car_boxes(scenario.vehicle, recording["x"], recording["y"], recording["yaw"])
    edge = float(edge_clearance(path, car, s).min())
    gaps = np.array([_clearances(car, obstacle_boxes(path, box, time)) for box in scenario.obstacles])
    if not len(gaps):
        return Judgement(_label(recording, np.inf, edge), None, None, None, None, edge)
    obstacle, sample = (int(i) for i in np.unravel_index(np.argmin(gaps), gaps.shape))
    gap = float(gaps[obstacle, sample])
    return Judgement(_label(recording, gap, edge), gap, obstacle, float(time[sample]), float(s[sample]), edge)


def _clearances(car: Array, box: Array) -> Array:
    """Signed clearance where it may be the smallest one; elsewhere that of the circumscribed circles, which is less."""
    apart = np.linalg.norm(car.mean(axis=1) - box.mean(axis=1), axis=1)
    radii = [np.linalg.norm(outline[0] - outline[0].mean(axis=0), axis=1).max() for outline in (car, box)]
    gaps = apart - sum(radii)
    near = gaps <= apart.min()
    gaps[near] = signed_clearance(car[near], box[near])
    return gaps


def _label(recording: Recording, gap: float, edge: float) -> str:
    if recording.end in (End.PLANT_INVALID, End.CONTROLLER_ERROR, End.BUS_ERROR):
        return recording.end.value
    if gap <= 0.0 or recording.contact:
        return "collision"
    if edge < 0.0:
        return "corridor violation"
    if recording.end is End.INTERRUPTED:
        return recording.end.value
    return "infeasible, handled" if recording.infeasible_steps else "ok"
