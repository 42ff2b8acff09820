"""A car that is held up: where it waits for what comes, and how much room it leaves itself to get out again."""

import math

import numpy as np

from sidestep.controller.decision.corridor import obstacle_polygons
from sidestep.controller.decision.lattice import LATERAL_STEP, layer_spacing
from sidestep.controller.decision.planner import FREE, PlannedPath, Start, plan_path
from sidestep.controller.decision.view import View, coming
from sidestep.controller.records import LAYERS
from sidestep.plant_models.kernels import Record, kernel

BRAKING_DELAY = 0.1
"""Until the brakes act, in [s]."""


@kernel
def plan_way(start: Start, view: View, held_up: bool, settings: Record) -> PlannedPath:
    """The path; a car that is held up waits where what comes passes it.

    The slower it gets the farther away it would meet them, which makes a passing possible on paper that its
    own acceleration makes impossible again. So all of an obstacle's lane is taken that comes, from where the car can
    both have stopped and be out of it, or from the obstacle itself if it is nearer; and what stands beyond that counts
    for little, as the car will stop before it.

    Args:
        start: Where the car is, and how fast.
        view: Obstacles, which are met everywhere.
        held_up: Whether the way was blocked in the step before.
        settings: PlannerSettings.
    """
    comes = coming(view, settings)
    if not (held_up and comes.any()):
        path = plan_path(start, view, settings)
        if path.blocker == FREE or not comes.any():
            return path
    stop = max(start.speed, 0.0) * (BRAKING_DELAY + 0.5 * start.speed / settings.braking)
    swept = _swept(start, view, comes, stop, settings)
    path = plan_path(start, swept, settings)
    if path.blocker == FREE:
        return path
    met_until = np.where(comes, np.inf, stop + settings.front)
    path = plan_path(start, View(swept.polygons, swept.speeds, swept.committed, met_until), settings)
    blocker = path.blocker
    # it comes along the only way
    if blocker >= 0 and comes[blocker] and (view.speeds[blocker] > 0.0 or path.room <= stop):
        return plan_path(start, view, settings)
    return path


@kernel
def _swept(start, view, comes, stop, settings):
    """The obstacles with the lanes that those which come will take; `stop` is where the car can stand, in [m]."""
    polygons, standing = view.polygons.copy(), np.maximum(view.speeds, 0.0)
    for m in range(comes.shape[0]):
        if comes[m]:
            along, across = view.polygons[m, :, 0], view.polygons[m, :, 1]
            begin, end = max(stop, _way_out(start.offset, across, start.speed, settings)), along.max()
            if end > -settings.rear:
                begin = min(along.min(), begin)
            if view.speeds[m] > 0.0:
                end, standing[m] = max(begin, 0.0) + (LAYERS + 1) * layer_spacing(start.speed), 0.0
            middle, width = 0.5 * (across.min() + across.max()), across.max() - across.min()
            lane = np.array([[0.5 * (begin + end), middle, end - begin, width, 0.0, 0.0]])
            polygons[m] = obstacle_polygons(lane, np.zeros(1))[0]
    return View(polygons, standing, view.committed, view.met_until)


@kernel
def _way_out(offset, lateral, speed, settings):
    """How far a car that is in an obstacle's lane drives until it can be out of it, in [m]; 0 if it cannot."""
    hard, pace = settings.half_width + settings.buffer, max(speed, 1.0)
    right, left = lateral.min() - hard, lateral.max() + hard
    sideways = math.inf
    if right >= settings.right_edge + hard:
        sideways = max(offset - right, 0.0)
    if left <= settings.left_edge - hard:
        sideways = min(sideways, max(left - offset, 0.0))
    if sideways == math.inf:
        return 0.0
    spacing = layer_spacing(speed)
    slope = max(int(min(settings.max_slope, settings.max_lateral_speed / pace) * spacing / LATERAL_STEP + 1e-9), 1)
    return sideways * spacing / (slope * LATERAL_STEP) + 2.0 * spacing + settings.reach


@kernel
def room_before(path: PlannedPath, pace: float, view: View, settings: Record) -> tuple[float, float]:
    """Distance that the front bumper may go to what blocks the path, in [m], and the speed of that, in [m/s].

    Infinite if nothing blocks it; less than there is where the car must swing out again; what comes has speed 0.
    """
    blocker = path.blocker
    if blocker == FREE:
        return math.inf, 0.0
    comes = coming(view, settings)
    if blocker < 0 or comes[blocker]:
        return path.room, 0.0
    gap = view.polygons[blocker, :, 0].min() - settings.front
    if comes.any():
        gap = _room_to_leave(gap, pace, view.polygons[blocker, :, 1], path, settings)
    return gap, view.speeds[blocker]


@kernel
def _room_to_leave(gap, pace, lateral, path, settings):
    """The gap less what the car needs to swing out from behind an obstacle.

    It still brakes comfortably, and stops where it waits: not before it is out of the way.
    """
    wait, there = path.offsets[-1], 0.0
    for i in range(path.stations.shape[0]):
        if abs(path.offsets[i] - wait) > LATERAL_STEP:
            there = path.stations[i]
    sideways = min(lateral.max() - wait, wait - lateral.min()) + settings.half_width + settings.buffer
    least = max(0.5 * pace * pace / settings.comfort_braking, there)
    return max(gap - max(sideways, 0.0) / settings.max_slope, min(gap, least))
