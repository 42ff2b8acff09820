"""How fast: the speed and the acceleration that are commanded, from the speed profile and from what else asks to slow.

The acceleration is the profile's own slope at the car. It knows nothing of the plant's speed control; that, where there
is no other way to drive a plant, gets the target speed.
"""

import math

from sidestep.controller.decision.corridor import excess_over
from sidestep.controller.decision.stopping import approach_speed, spare_braking, squeezed_speed
from sidestep.controller.records import PROFILE
from sidestep.plant_models.kernels import Record, kernel

STANDSTILL = 0.1
"""Speed below which the wheels are not turned, and the brakes hold a car that is not to move off, in [m/s]."""
SLOPE_TIME = 0.25
"""Over which the profile's slope is taken, in [s]: what an actuator answers to, and a gain of 4 1/s on speed errors."""
CLOSING_TIME = 0.5
"""In which a speed is reached that no profile leads to, in [s]."""
STOP_TIME = 0.1
"""In which a speed is lost at least, in [s], however little way is left."""
EASY_SHARE = 0.7
"""Of the braking that there is, up to which the car leaves it to its profile when to brake for what blocks the road."""
LATE_GAIN = 4.0
"""Where comfortable braking is too late, so many times what lacks is added: room is won first, and eased off later."""
KEPT_SHARE = 0.5
"""Of the braking at which it begins, down to which braking for what blocks the road goes on."""


@kernel
def choose_speed(m: Record, w: Record, c: Record, speed: float) -> tuple[float, float, float]:
    """What to command.

    Args:
        m: Memory.
        w: Work space with profile, states and the gap to what blocks the road.
        c: Settings.
        speed: Present one, in [m/s].

    Returns:
        Target speed [m/s], acceleration [m/s^2], and free distance before what blocks the road [m].
    """
    distance, pressing = math.inf, math.inf  # the latter: speed to come to at once
    target = min(m.cruise, w.bend_speed)
    if w.blocked:
        distance = w.gap - c.standstill_gap
        approach = approach_speed(distance, w.gap_speed, c.comfort_braking)
        target, pressing = min(target, approach), approach if distance <= 0.0 else math.inf
        if not c.grid.literal:
            target = min(target, speed_ahead(w, CLOSING_TIME)[0])
    squeezed = _squeezed(w, c, speed)
    target, pressing = min(target, squeezed), min(pressing, squeezed)
    if m.commanded:  # slowing that comes and goes from step to step would only waste grip
        target = min(target, max(m.command.target_speed, speed) + c.comfort_braking * c.period)
    spare = _spare(w, c, speed)
    target = max(target, speed - spare * CLOSING_TIME)
    if c.grid.literal:  # has no profile
        wanted = (target - speed) / CLOSING_TIME
    else:
        ahead, time = speed_ahead(w, SLOPE_TIME)
        slope = (ahead - w.profile_speed[0]) / time
        wanted = min(slope, (pressing - speed) / CLOSING_TIME, -_braking(m, w, c, speed, spare))
    wanted = min(wanted, max(target - speed, 0.0) / SLOPE_TIME)
    wanted = min(max(wanted, -spare), spare, c.planner.acceleration)
    if speed < STANDSTILL and wanted <= 0.0:
        wanted = -c.comfort_braking
    return target, wanted, max(distance, 0.0)


@kernel
def _braking(m, w, c, speed, spare):
    """For what blocks the road, from the moment on at which it is due; -inf before."""
    if not w.blocked:
        return -math.inf
    due = min(c.comfort_braking, EASY_SHARE * spare)
    if m.commanded and m.command.acceleration < -KEPT_SHARE * due:
        due *= KEPT_SHARE
    needed = needed_braking(speed - max(w.gap_speed, 0.0), w.gap - c.standstill_gap)
    if needed < due:
        return -math.inf
    return needed + (LATE_GAIN - 1.0) * max(needed - c.comfort_braking, 0.0)


@kernel
def speed_ahead(w: Record, later: float) -> tuple[float, float]:
    """Speed of the profile `later` [s] from now, in [m/s], and the time until then, or until it stops, in [s]."""
    speeds, time = w.profile_speed, 0.0
    for i in range(PROFILE - 1):
        mean = 0.5 * (speeds[i] + speeds[i + 1])
        needed = w.profile_step / mean if mean > 0.0 else math.inf
        if time + needed >= later:
            return speeds[i] + mean * (speeds[i + 1] - speeds[i]) / w.profile_step * (later - time), later
        time += needed
        if speeds[i + 1] <= 0.0:
            return 0.0, time
    return speeds[PROFILE - 1], time


@kernel
def needed_braking(closing: float, distance: float) -> float:
    """Constant braking [m/s^2] that loses a speed [m/s] within a distance [m], but in no less than STOP_TIME."""
    if closing <= 0.0:
        return 0.0
    return 0.5 * closing * closing / max(distance, 0.5 * closing * STOP_TIME)


@kernel
def _squeezed(w, c, speed):
    """Speed asked for by a prediction that leaves the corridor; infinite if it does not."""
    if w.slack_corridor <= c.tightening:
        return math.inf
    worst, first = excess_over(w, c.grid)
    room = speed * min(first, c.grid.times[c.grid.nodes - 1]) - c.front
    return squeezed_speed(worst - c.tightening, room, w.blocked, c)


@kernel
def _spare(w, c, speed):
    """Braking that car and tyres have left beside the turn ahead, in [m/s^2]."""
    swerve = 0.0
    for k in range(c.grid.swerve):
        swerve = max(swerve, abs(w.states[k, 3]))
    return min(spare_braking(speed * swerve, c.car.friction), c.planner.braking)
