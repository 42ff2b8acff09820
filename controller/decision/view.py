"""What can be met on the way, and the sides on which it was to be passed."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.decision.lattice import arrival_times, layer_spacing
from sidestep.controller.records import LAYERS, OBSTACLES
from sidestep.plant_models.kernels import Array, Record, kernel

VIEW_TIME = 6.0
"""How far ahead in time obstacles are looked at at least, in [s]."""
VIEW_MARGIN = 10.0
"""Beyond the lattice and behind the car, in [m], up to which obstacles are looked at."""
VIEW_BEHIND = 3.0
"""How much longer they are looked at behind the car, in [s]: the way back lasts as long."""


class View(NamedTuple):
    """Obstacles in the road frame, from the car on.

    Attributes:
        polygons, speeds: Outlines, shape (M, 8, 2), in [m], and speeds along the road, shape (M,), in [m/s].
        committed: Passing sides kept from the step before, 0 for none, shape (M,).
        met_until: Stations beyond which the car may stop before it meets an obstacle, shape (M,), in [m].
    """

    polygons: Array
    speeds: Array
    committed: NDArray[np.int64]
    met_until: Array


@kernel
def in_view(
    s: float, speed: float, cruise: float, now: float, boxes: Array, period: float, settings: Record
) -> tuple[NDArray[np.int64], Array]:
    """Which boxes can be met on the way, and these with s from the car on, at present.

    Args:
        s: Of the car, in [m].
        speed, cruise: Present speed, and the one to go back to, in [m/s].
        now: Time, in [s].
        boxes: See `corridor.obstacle_polygons`, but with absolute s as they stood at time 0, shape (M, 6).
        period: Of the ReferencePath, in [m].
        settings: PlannerSettings.
    """
    end = (LAYERS + 1) * layer_spacing(speed)
    until = max(arrival_times(np.array([end]), speed, cruise, settings.acceleration)[0], VIEW_TIME)
    begin = -settings.rear - VIEW_MARGIN - VIEW_BEHIND * max(speed, 0.0)
    near, ahead = np.empty(boxes.shape[0], np.int64), np.empty(boxes.shape[0])
    count = 0
    for m in range(boxes.shape[0]):
        now_at = boxes[m, 0] + boxes[m, 5] * now - s
        if period > 0.0:
            now_at -= period * round(now_at / period)
        reach, then_at = math.hypot(boxes[m, 2], boxes[m, 3]), now_at + boxes[m, 5] * until
        if max(now_at, then_at) + reach > begin and min(now_at, then_at) - reach < end + settings.front + VIEW_MARGIN:
            near[count], ahead[count] = m, now_at
            count += 1
    near = near[:count]
    boxes = boxes[near]
    boxes[:, 0] = ahead[:count]
    return near, boxes


@kernel
def coming(view: View, settings: Record) -> NDArray[np.bool_]:
    """Which obstacles would run into a car that stands in their lane: oncoming ones, and those from behind."""
    speeds = view.speeds
    found = np.zeros(speeds.shape[0], np.bool_)
    for m in range(speeds.shape[0]):
        end = view.polygons[m, :, 0].max()
        found[m] = end > -settings.rear if speeds[m] < 0.0 else speeds[m] > 0.0 and end < settings.front
    return found


@kernel
def moves(view: View, settings: Record) -> bool:
    """Whether anything moves that is not behind, or comes from there."""
    for m in range(view.speeds.shape[0]):
        if view.speeds[m] != 0.0 and view.polygons[m, :, 0].max() > -settings.rear:
            return True
    return bool(coming(view, settings).any())


@kernel
def sides_of(near: NDArray[np.int64], m: Record) -> NDArray[np.int64]:
    """Passing sides kept of the obstacles in view."""
    sides = np.zeros(near.shape[0], np.int64)
    for i in range(near.shape[0]):
        for k in range(m.obstacles):
            if m.ids[k] == near[i]:
                sides[i] = m.sides[k]
    return sides


@kernel
def remember(near: NDArray[np.int64], sides: NDArray[np.int64], blocked: bool, m: Record, plan: Record) -> None:
    """Keep the passing sides for the next step; a car that is held up keeps those that it had."""
    plan.obstacles = min(near.shape[0], OBSTACLES)
    before = m.obstacles
    for i in range(plan.obstacles):
        plan.ids[i], plan.sides[i] = near[i], sides[i]
    count = plan.obstacles
    ids, kept = plan.ids.copy(), plan.sides.copy()
    if blocked:
        for k in range(before):
            known = False
            for i in range(plan.obstacles):
                if ids[i] == m.ids[k]:
                    known = True
                    if kept[i] == 0:
                        kept[i] = m.sides[k]
            if not known and m.sides[k] != 0 and count < OBSTACLES:
                ids[count], kept[count] = m.ids[k], m.sides[k]
                count += 1
    m.obstacles, m.held_up = count, blocked
    for i in range(count):
        m.ids[i], m.sides[i] = ids[i], kept[i]
