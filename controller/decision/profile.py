"""How fast the car may be where: a speed profile, by the bends ahead, the room on the way and what blocks it."""

import math

from sidestep.controller.decision.planner import PlannedPath
from sidestep.controller.records import LAYERS, PROFILE
from sidestep.plant_models.kernels import Array, Record, kernel
from sidestep.plant_models.road.clothoid import curvature_at

LEAST_VIEW, VIEW_TIME = 20.0, 2.0
"""What the profile looks ahead beyond a comfortable stop, in [m] and in [s] at the present speed."""
RESPONSE = 0.5
"""How far ahead in time the speed is taken that is asked for now, in [s]: a speed control takes so long to follow."""
STRAIGHT = 1e-6
"""Curvature that is none, in [1/m]."""


@kernel
def profile(w: Record, c: Record, road: tuple[Array, float], speed: float, cruise: float, path: PlannedPath) -> bool:
    """Fill the speeds `profile_speed` at stations `profile_step` apart from the car on.

    Caps by bends, v^2 kappa <= a, by the way's own bends and room, and by what blocks the road are made drivable by a
    pass backwards with the braking that they need, comfortable if that suffices and as hard as the road allows if
    not, and by a pass forwards with the car's own acceleration.

    Args:
        w: Work space; `gap`, `gap_speed` and `blocked` say what blocks the road.
        c: Settings.
        road: Table and period of the ReferencePath.
        speed, cruise: Present speed, and the one to go back to, in [m/s].
        path: What the way itself allows.

    Returns:
        Whether a bend or the way asks for less than the cruising speed.
    """
    v, p, caps = max(speed, 0.0), c.planner, w.profile_speed
    w.profile_step = step = (LEAST_VIEW + VIEW_TIME * v + 0.5 * v * v / c.comfort_braking) / (PROFILE - 1)
    bends, j = False, 0
    for i in range(PROFILE):
        while j < LAYERS and path.stations[j + 1] < i * step:
            j += 1
        bend = max(abs(curvature_at(road[0], road[1], w.station + (i - 0.5) * step)),
                   abs(curvature_at(road[0], road[1], w.station + i * step)), STRAIGHT)  # fmt: skip
        way = min(path.speeds[j], path.speeds[min(j + 1, LAYERS)])
        caps[i] = min(cruise, way, math.sqrt(c.bend_acceleration / bend))
        bends = bends or caps[i] < cruise
        if w.blocked and i * step >= w.gap - c.standstill_gap:
            caps[i] = min(caps[i], max(w.gap_speed, 0.0))
    braking = c.comfort_braking
    for i in range(1, PROFILE):
        braking = max(braking, 0.5 * (v * v - caps[i] * caps[i]) / (i * step))
    _make_drivable(caps, step, v, min(braking, p.braking), p.acceleration)
    return bends


@kernel
def _make_drivable(caps, step, speed, braking, acceleration):
    """Turn caps into speeds that begin with the present one, in [m/s]; braking and acceleration in [m/s^2]."""
    for i in range(PROFILE - 2, -1, -1):
        caps[i] = min(caps[i], math.sqrt(caps[i + 1] ** 2 + 2.0 * braking * step))
    caps[0] = speed
    for i in range(1, PROFILE):
        squared = caps[i - 1] ** 2
        most, least = squared + 2.0 * acceleration * step, squared - 2.0 * braking * step
        caps[i] = max(min(caps[i], math.sqrt(most)), math.sqrt(max(least, 0.0)))


@kernel
def drive_along(w: Record, grid: Record) -> float:
    """Mean speed of each prediction step from the profile, into `speed`, and the mean over each group's steps.

    Returns:
        The speed after RESPONSE, in [m/s].
    """
    i, left, v, asked, passed = 0, w.profile_step, w.profile_speed[0], w.profile_speed[0], 0.0
    for k in range(grid.nodes):
        remaining, way = grid.steps[k], 0.0
        while remaining > 0.0 and i < PROFILE - 1:
            slope = 0.5 * (w.profile_speed[i + 1] ** 2 - w.profile_speed[i] ** 2) / w.profile_step
            needed = _time_over(v, slope, left)
            if needed > remaining:
                gone = min(max(v * remaining + 0.5 * slope * remaining**2, 0.0), left)
                way, left, v, remaining = way + gone, left - gone, max(v + slope * remaining, 0.0), 0.0
            else:
                way, remaining, i, left = way + left, remaining - needed, i + 1, w.profile_step
                v = w.profile_speed[i]
        way += v * remaining
        w.speed[k] = way / grid.steps[k]
        passed += grid.steps[k]
        if passed <= RESPONSE + 0.5 * grid.steps[k]:
            asked = v
    _average(w, grid)
    return asked


@kernel
def _time_over(v, slope, way):
    """Time to cover a way [m] from a speed [m/s] at an acceleration [m/s^2]; infinite if the car stops before."""
    root = v * v + 2.0 * slope * way
    if root <= 0.0:
        return math.inf
    return 2.0 * way / (v + math.sqrt(root))


@kernel
def _average(w, grid):
    total, time = 0.0, 0.0
    for k in range(grid.nodes):
        total, time = total + w.speed[k] * grid.steps[k], time + grid.steps[k]
        if k == grid.nodes - 1 or grid.group[k + 1] != grid.group[k]:
            w.group_speed[grid.group[k]] = total / time
            total = time = 0.0
