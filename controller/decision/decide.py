"""Planner and corridor of one control step: what the MPC tracks and must stay within."""

import math

import numpy as np

from sidestep.controller.decision.corridor import footprint_bounds, obstacle_polygons, path_reference
from sidestep.controller.decision.lattice import LATERAL_STEP, LAYERS, arrival_times, layer_spacing
from sidestep.controller.decision.planner import FREE, plan_path
from sidestep.controller.decision.profile import drive_along, profile
from sidestep.controller.mpc.prediction import along_road, sampled
from sidestep.controller.records import OBSTACLES
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import curvature_at

VIEW_TIME = 6.0
"""How far ahead in time obstacles are looked at at least, in [s]."""
VIEW_MARGIN = 10.0
"""Beyond the lattice and behind the car, in [m], up to which obstacles are looked at."""
VIEW_BEHIND = 3.0
"""How much longer they are looked at behind the car, in [s]: the way back lasts as long."""
BRAKING_DELAY = 0.1
"""Until the brakes act, in [s]."""
EASE, END_EASE = 0.03, 0.3
"""Share of the tracking costs before the car is back on the reference, where the corridor says enough and the way
is to be gentle, and their least share at the end of the horizon, which must not hang in the air."""
FULL_EASE_SPEED = 15.0
"""Speed from which on it is as gentle as that, in [m/s]; not at all below half of it, where nobody feels it."""
SLOPE_TIME = 0.3
"""Half the time over which the path's slope is averaged, in [s]."""
EDGE_TIME = 1.0
"""How long before what comes, and after, the road's edge is no reason to slow down, in [s]."""


@kernel
def _in_view(s, speed, cruise, now, boxes, period, settings):
    """Which boxes can be met on the way, and these with s from the car on, at present."""
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
def _way_out(offset, lateral, speed, settings):
    """How far a car that is in an obstacle's lane drives until it can be out of it, in [m]; 0 if it cannot."""
    hard, pace = settings.half_width + settings.buffer, max(speed, 1.0)
    right, left = lateral.min() - hard, lateral.max() + hard
    aside = math.inf
    if right >= settings.right_edge + hard:
        aside = max(offset - right, 0.0)
    if left <= settings.left_edge - hard:
        aside = min(aside, max(left - offset, 0.0))
    if aside == math.inf:
        return 0.0
    spacing = layer_spacing(speed)
    slope = max(int(min(settings.max_slope, settings.max_lateral_speed / pace) * spacing / LATERAL_STEP + 1e-9), 1)
    return aside * spacing / (slope * LATERAL_STEP) + 2.0 * spacing + settings.reach


@kernel
def _coming(polygons, speeds, settings):
    """Which obstacles would run into a car that stands in their lane: oncoming ones, and those from behind."""
    coming = np.zeros(speeds.shape[0], np.bool_)
    for m in range(speeds.shape[0]):
        end = polygons[m, :, 0].max()
        coming[m] = end > -settings.rear if speeds[m] < 0.0 else speeds[m] > 0.0 and end < settings.front
    return coming


@kernel
def _plan(s, offset, speed, cruise, polygons, speeds, committed, held_up, settings):
    """The path; a car that is held up waits where what comes passes it.

    The slower it gets the farther away it would meet them, which makes a passing possible on paper that its
    own acceleration makes impossible again. So all of an obstacle's lane is taken that comes, from where the car can
    both have stopped and be out of it, or from the obstacle itself if it is nearer; and what stands beyond that counts
    for little, as the car will stop before it.
    """
    everywhere = np.full(speeds.shape[0], np.inf)
    coming = _coming(polygons, speeds, settings)
    if not (held_up and coming.any()):
        path = plan_path(s, offset, speed, cruise, polygons, speeds, committed, everywhere, settings)
        if path.blocker == FREE or not coming.any():
            return path
    stop = max(speed, 0.0) * (BRAKING_DELAY + 0.5 * speed / settings.braking)
    swept, standing = polygons.copy(), np.maximum(speeds, 0.0)
    for m in range(speeds.shape[0]):
        if coming[m]:
            along, across = polygons[m, :, 0], polygons[m, :, 1]
            begin, end = max(stop, _way_out(offset, across, speed, settings)), along.max()
            if end > -settings.rear:
                begin = min(along.min(), begin)
            if speeds[m] > 0.0:
                end, standing[m] = max(begin, 0.0) + (LAYERS + 1) * layer_spacing(speed), 0.0
            middle, width = 0.5 * (across.min() + across.max()), across.max() - across.min()
            lane = np.array([[0.5 * (begin + end), middle, end - begin, width, 0.0, 0.0]])
            swept[m] = obstacle_polygons(lane, np.zeros(1))[0]
    path = plan_path(s, offset, speed, cruise, swept, standing, committed, everywhere, settings)
    if path.blocker == FREE:
        return path
    certain = np.where(coming, np.inf, stop + settings.front)
    path = plan_path(s, offset, speed, cruise, swept, standing, committed, certain, settings)
    blocker = path.blocker
    if blocker >= 0 and coming[blocker] and (speeds[blocker] > 0.0 or path.room <= stop):  # it comes along the only way
        return plan_path(s, offset, speed, cruise, polygons, speeds, committed, everywhere, settings)
    return path


@kernel
def _room_to_leave(gap, pace, lateral, stations, offsets, settings):
    """The gap less what the car needs to swing out from behind an obstacle.

    It still brakes comfortably, and stops where it waits: not before it is out of the way.
    """
    wait, there = offsets[-1], 0.0
    for i in range(stations.shape[0]):
        if abs(offsets[i] - wait) > LATERAL_STEP:
            there = stations[i]
    aside = min(lateral.max() - wait, wait - lateral.min()) + settings.half_width + settings.buffer
    least = max(0.5 * pace * pace / settings.comfort_braking, there)
    return max(gap - max(aside, 0.0) / settings.max_slope, min(gap, least))


@kernel
def _gap(blocker, room, pace, stations, offsets, polygons, speeds, settings):
    """Fields gap and gap_speed of `Corridor`."""
    if blocker == FREE:
        return math.inf, 0.0
    coming = _coming(polygons, speeds, settings)
    if blocker < 0 or coming[blocker]:
        return room, 0.0
    gap = polygons[blocker, :, 0].min() - settings.front
    if coming.any():
        gap = _room_to_leave(gap, pace, polygons[blocker, :, 1], stations, offsets, settings)
    return gap, speeds[blocker]


@kernel
def _firmness(stations, settled, pace, gentle):
    """Field firmness of `Corridor`."""
    full = min(max(2.0 * pace / FULL_EASE_SPEED - 1.0, 0.0), 1.0) if gentle else 0.0
    firmness = np.where(stations < settled, EASE**full, 1.0)
    firmness[-1] = max(firmness[-1], END_EASE)
    return firmness


@kernel
def _drive_ahead(w, grid, road, offset, direction):
    """Stations of the nodes from the car on, the road's curvature there and its heading rate on the way there.

    A car that goes across the road gets less far along it, and one on the inside of a bend farther: (1) as it is.
    """
    n, station, before = grid.nodes, 0.0, w.x0[1] + w.x0[2]
    stations, curvature, turn_rate = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        pace = w.speed[k]
        half = 0.5 * pace * grid.steps[k]
        bend = curvature_at(road[0], road[1], w.station + station + half)
        progress = along_road(pace, bend, offset[k], 0.5 * (before + direction[k]))
        if grid.literal:
            progress = pace
        station += progress * grid.steps[k]
        stations[k], before, turn_rate[k] = station, direction[k], progress * bend
        curvature[k] = curvature_at(road[0], road[1], w.station + station)
        if grid.literal:  # v kappa at the node, as printed
            turn_rate[k] = pace * curvature[k]
    return stations, curvature, turn_rate


@kernel
def _bounds(way, sides, edges, c):
    stations, reach, direction, turn, curvature, polygons, speeds = way
    grid, n = c.grid, c.grid.nodes
    return footprint_bounds(
        stations, grid.times[:n], reach, c.buffer, grid.levers, grid.clearance[:n], direction,
        turn, curvature, polygons, speeds, sides, *edges,
    )  # fmt: skip


@kernel
def _sides_of(near, m):
    """Passing sides kept of the obstacles in view."""
    sides = np.zeros(near.shape[0], np.int64)
    for i in range(near.shape[0]):
        for k in range(m.obstacles):
            if m.ids[k] == near[i]:
                sides[i] = m.sides[k]
    return sides


@kernel
def _remember(near, sides, blocked, m, plan):
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


@kernel
def _choose_speeds(m, w, c, road, speed):
    """Speeds of the prediction steps, and what a bend asks for; the literal paper holds its speed."""
    if c.grid.literal:
        w.speed[:], w.group_speed[:], w.bend_speed = speed, speed, math.inf
        return
    bends = profile(w, c, road, speed, m.cruise)
    asked = drive_along(w, c.grid)
    w.bend_speed = asked if bends else math.inf


@kernel
def decide(m, w, c, road, boxes, state, plan):
    """Search the path and bound the footprint along the prediction.

    Args:
        m: Memory.
        w: Work space, located; path, corridor and gap at the nodes are filled.
        c: Settings.
        road: Table and period of the ReferencePath.
        boxes: See `corridor.obstacle_polygons`, but with absolute s as they stood at time 0, shape (M, 6).
        state: Record of `STATE`.
        plan: Record of `PLAN`; the path is filled.
    """
    s, speed, p, grid = w.station, state.v_x, c.planner, c.grid
    table, period, n = road[0], road[1], grid.nodes
    gentle = m.last < 0 or m.plans[m.last].feasible
    near, boxes = _in_view(s, speed, m.cruise, w.time, boxes, period, p)
    bend = np.empty(boxes.shape[0])
    for i in range(boxes.shape[0]):
        bend[i] = curvature_at(table, period, s + boxes[i, 0])
    polygons, speeds = obstacle_polygons(boxes, bend), boxes[:, 5].copy()
    committed = _sides_of(near, m)
    path = _plan(s, w.x0[0], speed, m.cruise, polygons, speeds, committed, m.held_up, p)
    sides, blocked = path.sides, path.blocker != FREE
    if blocked:  # stopping, not passing: no time to change sides, nor need to insist on one
        sides[sides * committed < 0] = 0

    pace = max(speed, 0.0)
    w.gap, w.gap_speed = _gap(path.blocker, path.room, pace, path.stations, path.offsets, polygons, speeds, p)
    w.blocked = blocked
    _choose_speeds(m, w, c, road, pace)
    direction, turn, offset = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        later = grid.times[k] + w.age
        offset[k] = sampled(w.before, 0, later, grid)
        direction[k] = sampled(w.before, 1, later, grid) + sampled(w.before, 2, later, grid)
        turn[k] = sampled(w.before, 3, later, grid) / max(w.speed[k], 1.0)
    stations, curvature, turn_rate = _drive_ahead(w, grid, road, offset, direction)
    offsets, slope = path_reference(path.stations, path.offsets, stations, max(1.0, SLOPE_TIME * pace))
    edges, coming = (p.right_edge, p.left_edge), _coming(polygons, speeds, p)
    way = stations, 0.5 * w.speed[:n] * grid.steps[:n], direction, turn, curvature, polygons, speeds
    bounds = _bounds(way, sides, edges, c)
    heeded = bounds
    if coming.any():
        others = np.where(coming, 0, sides)
        heeded = _bounds(way, others, edges, c)
        edgeless = _bounds(way, others, (-math.inf, math.inf), c)
        for k in range(n):
            if (heeded[:, k] != bounds[:, k]).any():
                begin = np.searchsorted(grid.times[:n], grid.times[k] - EDGE_TIME)
                heeded[:, begin:] = edgeless[:, begin:]
                break
    if path.blocker >= 0:
        sides[path.blocker] = 0  # the car waits for it
    firmness = _firmness(stations, path.settled, pace, gentle and not blocked)
    for k in range(n):
        w.stations[k], w.path[k], w.heading[k] = stations[k], offsets[k], slope[k]
        w.firmness[k], w.turn_rate[k] = firmness[k], turn_rate[k]
        for i in range(4):
            w.bounds[i, k], w.heeded[i, k] = bounds[i, k], heeded[i, k]
    plan.layers = path.stations.shape[0]
    for i in range(plan.layers):
        plan.s[i], plan.l[i], plan.left[i], plan.right[i] = (
            s + path.stations[i],
            path.offsets[i],
            path.left[i],
            path.right[i],
        )
    _remember(near, sides, blocked, m, plan)
