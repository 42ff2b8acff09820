"""Stopping before what blocks the road: how fast the car may still be, and how hard it can brake."""

import math

from sidestep.plant_models.kernels import Record, kernel
from sidestep.plant_models.vehicle.parameters import GRAVITY

SPEED_RESPONSE = 1.0
"""Response time assumed of the plant's speed control, in [s]: twice that of our plants, which keeps the last
metres from overshooting."""
GRIP_SHARE, LEAST_BRAKING = 0.85, 1.0
"""Share of friction times gravity that braking and swerving share, and the braking that is always left [m/s^2]: the
tyres give no more in both directions together, and the prediction does not know of what braking takes."""
SWERVE_TIME = 0.6
"""How far ahead the swerve counts that braking must leave grip for, in [s]."""
SLOWING_SHARE = 0.25
"""Share of the buffer that a prediction may use up before the car slows down for it."""
CREEP_SPEED = 2.0
"""Speed left when the corridor cannot be held: standing still, the car would never come back into it, in [m/s]."""
GAP_TIME = 2.0
"""Time in which a gap that is too small is opened again, in [s]."""


@kernel
def approach_speed(distance: float, obstacle_speed: float, braking: float) -> float:
    """Target speed at a distance before an obstacle.

    Braking at a constant rate towards the obstacle's speed, asked for early by the response time tau of a
    first-order speed control: v = v_o + sqrt(a^2 tau^2 + 2 a d) - a tau. Where the distance is too short
    for that rate the target lies far below the speed, and the speed control brakes as hard as it can. Closer
    than wanted, the car falls back from a moving obstacle.

    Args:
        distance: Free distance beyond the gap to keep, in [m]; negative if closer.
        obstacle_speed: Along the road, in [m/s]; oncoming counts as standing.
        braking: a, in [m/s^2].
    """
    ahead = max(obstacle_speed, 0.0)
    if distance < 0.0:
        return max(ahead + distance / GAP_TIME, 0.0)
    lead = braking * SPEED_RESPONSE
    return ahead + math.sqrt(lead * lead + 2.0 * braking * distance) - lead


@kernel
def spare_braking(lateral: float, friction: float) -> float:
    """Deceleration that the tyres have left beside a lateral acceleration; both in [m/s^2]."""
    grip = GRIP_SHARE * friction * GRAVITY
    return math.sqrt(max(grip * grip - lateral * lateral, LEAST_BRAKING**2))


@kernel
def squeezed_speed(excess: float, room: float, blocked: bool, config: Record) -> float:
    """Target speed for a prediction that leaves the corridor, in [m/s]; infinite if that is no reason to slow down.

    Args:
        excess: Of the prediction over `slowing_bounds` without the tightening, in [m].
        room: From the front bumper to where it begins, in [m].
        blocked: Whether the road is blocked, too: then nothing is gained by creeping on.
        config: Settings of the controller.
    """
    if excess <= SLOWING_SHARE * config.buffer:
        return math.inf
    return max(approach_speed(max(room, 0.0), 0.0, config.comfort_braking), 0.0 if blocked else CREEP_SPEED)
