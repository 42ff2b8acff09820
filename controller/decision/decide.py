"""Planner and corridor of one control step: what the MPC tracks and must stay within."""

import math

import numpy as np

from sidestep.controller.decision.corridor import Motion, Outline, footprint_bounds, obstacle_polygons, path_reference
from sidestep.controller.decision.narrow import is_narrow, plan_narrow
from sidestep.controller.decision.planner import FREE, Start, around
from sidestep.controller.decision.profile import drive_along, profile
from sidestep.controller.decision.view import View, coming, in_view, moves, remember, sides_of
from sidestep.controller.decision.waiting import plan_way, room_before
from sidestep.controller.mpc.prediction import along_road, sampled
from sidestep.plant_models.kernels import Array, Record, kernel
from sidestep.plant_models.road.clothoid import curvature_at

EASE, END_EASE = 0.03, 0.3
"""Share of the tracking costs before the car is back on the reference, where the corridor says enough and the way
is to be gentle, and their least share at the end of the horizon, which must not hang in the air."""
FULL_EASE_SPEED = 15.0
"""Speed from which on it is as gentle as that, in [m/s]; not at all below half of it, where nobody feels it."""
NARROW_TRACKING = 20.0
"""Times the tracking costs where the way is narrow: a share of a metre matters, and the car is slow."""
STRAIGHT = 0.1
"""Slope of the car's way up to which it is handed back to the lattice, whose search knows of none, in [rad]."""
SLOPE_TIME = 0.3
"""Half the time over which the path's slope is averaged, in [s]."""
EDGE_TIME = 1.0
"""How long before what comes, and after, the road's edge is no reason to slow down, in [s]."""


@kernel
def _tracking_shares(stations, settled, pace, gentle):
    """Share of the tracking costs at each node, see EASE."""
    full = min(max(2.0 * pace / FULL_EASE_SPEED - 1.0, 0.0), 1.0) if gentle else 0.0
    tracking_share = np.where(stations < settled, EASE**full, 1.0)
    tracking_share[-1] = max(tracking_share[-1], END_EASE)
    return tracking_share


@kernel
def _drive_ahead(w, grid, road):
    """How the car will move, as the last plan has it, and the road's heading rate on the way, in [rad/s].

    A car that goes across the road gets less far along it, and one on the inside of a bend farther: (1) as it is.
    """
    n, station, before = grid.nodes, 0.0, w.x0[1] + w.x0[2]
    stations, direction, turn, curvature, rate = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        later, pace = grid.times[k] + w.age, w.speed[k]
        direction[k] = sampled(w.before, 1, later, grid) + sampled(w.before, 2, later, grid)
        turn[k] = sampled(w.before, 3, later, grid) / max(pace, 1.0)
        bend = curvature_at(road[0], road[1], w.station + station + 0.5 * pace * grid.steps[k])
        progress = along_road(pace, bend, sampled(w.before, 0, later, grid), 0.5 * (before + direction[k]))
        if grid.literal:
            progress = pace
        station += progress * grid.steps[k]
        stations[k], before, rate[k] = station, direction[k], progress * bend
        curvature[k] = curvature_at(road[0], road[1], w.station + station)
        if grid.literal:  # v kappa at the node, as printed
            rate[k] = pace * curvature[k]
    reach = 0.5 * w.speed[:n] * grid.steps[:n]
    return Motion(stations, grid.times[:n], reach, direction, turn, curvature), rate


@kernel
def _slowing_bounds(bounds, motion, view, sides, outline, c):
    """The bounds without what comes, and without the road's edges from EDGE_TIME before that on.

    Slowing down does not get the car away from what comes, which may drive it over the edge.
    """
    p, comes = c.planner, coming(view, c.planner)
    if not comes.any():
        return bounds
    others, times = np.where(comes, 0, sides), motion.times
    slowing = footprint_bounds(motion, view, others, (p.right_edge, p.left_edge), c.buffer, outline)
    edgeless = footprint_bounds(motion, view, others, (-math.inf, math.inf), c.buffer, outline)
    for k in range(times.shape[0]):
        if (slowing[:, k] != bounds[:, k]).any():
            begin = np.searchsorted(times, times[k] - EDGE_TIME)
            slowing[:, begin:] = edgeless[:, begin:]
            break
    return slowing


@kernel
def _clearances(path, stations, c):
    """What is to stay free at the nodes: what a narrow way leaves, where that is less than what is asked for."""
    p, clearance = c.planner, c.grid.clearance[: stations.shape[0]].copy()
    gaps = np.interp(stations, path.stations, path.gaps)
    for k in range(stations.shape[0]):
        clearance[k] = min(clearance[k], p.half_width + max(gaps[k], p.least_clearance))
    return clearance


@kernel
def _way_of_leader(w, c, speed):
    """How far what blocks the way moves on while the car brakes to its speed, in [m]: where it is now is too early."""
    if not w.blocked or w.gap_speed <= 0.0:
        return 0.0
    return w.gap_speed * max(speed - w.gap_speed, 0.0) / c.comfort_braking


@kernel
def _choose_speeds(m, w, c, road, speed, path):
    """Speeds of the prediction steps, and what a bend asks for; the literal paper holds its speed."""
    if c.grid.literal:
        w.speed[:], w.group_speed[:], w.bend_speed = speed, speed, math.inf
        return
    w.gap += _way_of_leader(w, c, speed)
    bends = profile(w, c, road, speed, m.cruise, path)
    w.gap -= _way_of_leader(w, c, speed)
    asked = drive_along(w, c.grid)
    w.bend_speed = asked if bends else math.inf


@kernel
def _look(m, w, c, road, boxes, speed):
    """The obstacles in view, and their numbers."""
    near, boxes = in_view(w.station, speed, m.cruise, w.time, boxes, road[1], c.planner)
    bend = np.empty(boxes.shape[0])
    for i in range(boxes.shape[0]):
        bend[i] = curvature_at(road[0], road[1], w.station + boxes[i, 0])
    everywhere = np.full(boxes.shape[0], np.inf)
    return near, View(obstacle_polygons(boxes, bend), boxes[:, 5].copy(), sides_of(near, m), everywhere)


@kernel
def _last_way(plan, followed):
    count = plan.layers if followed else 0
    return plan.s[:count], plan.l[:count]


@kernel
def _squeezed(m, w, c, view, path, speed):
    """A slow way through what stands close, where the path is blocked, and to its end; the path where there is none."""
    blocked, followed = path.blocker != FREE, m.narrow
    m.narrow = False
    if c.grid.literal or not (blocked or followed) or moves(view, c.planner):
        return path
    last, pose = m.plans[max(m.last, 0)], (w.station, w.x0[0], w.x0[1] + w.x0[2])
    way = plan_narrow(pose, speed, _last_way(last, followed), view, c.planner)
    straight = abs(pose[2]) < STRAIGHT and last.feasible
    m.narrow = way.found and (blocked or not straight or is_narrow(way, c.planner))
    return around(way, view, c.bend_acceleration, c.planner) if m.narrow else path


@kernel
def decide(
    m: Record, w: Record, c: Record, road: tuple[Array, float], boxes: Array, state: Record, plan: Record
) -> None:
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
    speed, pace, p, grid = state.v_x, max(state.v_x, 0.0), c.planner, c.grid
    gentle = m.last < 0 or m.plans[m.last].feasible
    near, view = _look(m, w, c, road, boxes, speed)
    path = plan_way(Start(w.station, w.x0[0], speed, m.cruise), view, m.held_up, p)
    path = _squeezed(m, w, c, view, path, pace)
    sides, blocked = path.sides, path.blocker != FREE
    if blocked:  # stopping, not passing: no time to change sides, nor need to insist on one
        sides[sides * view.committed < 0] = 0
    w.gap, w.gap_speed = room_before(path, pace, view, p)
    w.blocked = blocked
    _choose_speeds(m, w, c, road, pace, path)
    motion, turn_rate = _drive_ahead(w, grid, road)
    offsets, slope = path_reference(path.stations, path.offsets, motion.stations, max(1.0, SLOPE_TIME * pace))
    outline = Outline(grid.levers, _clearances(path, motion.stations, c))
    bounds = footprint_bounds(motion, view, sides, (p.right_edge, p.left_edge), c.buffer, outline)
    slowing = _slowing_bounds(bounds, motion, view, sides, outline, c)
    if path.blocker >= 0:
        sides[path.blocker] = 0  # the car waits for it
    tracking_share = _tracking_shares(motion.stations, path.settled, pace, gentle and not blocked and not m.narrow)
    if m.narrow:
        tracking_share *= NARROW_TRACKING
    for k in range(grid.nodes):
        w.stations[k], w.path[k], w.heading[k] = motion.stations[k], offsets[k], slope[k]
        w.tracking_share[k], w.turn_rate[k] = tracking_share[k], turn_rate[k]
        for i in range(4):
            w.bounds[i, k], w.slowing_bounds[i, k] = bounds[i, k], slowing[i, k]
    plan.layers = path.stations.shape[0]
    for i in range(plan.layers):
        plan.s[i], plan.l[i] = w.station + path.stations[i], path.offsets[i]
        plan.left[i], plan.right[i] = path.left[i], path.right[i]
    remember(near, sides, blocked, m, plan)
