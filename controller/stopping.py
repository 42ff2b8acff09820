"""Stopping before what blocks the road: how fast the car may still be."""

import math

SPEED_RESPONSE = 0.5
"""Response time assumed of the plant's speed control, in [s]."""


def approach_speed(distance: float, obstacle_speed: float, braking: float) -> float:
    """Target speed at a distance before an obstacle.

    Braking at a constant rate towards the obstacle's speed, asked for early by the response time tau of a
    first-order speed control: v = v_o + sqrt(a^2 tau^2 + 2 a d) - a tau. Where the distance is too short
    for that rate the target lies far below the speed, and the speed control brakes as hard as it can.

    Args:
        distance: Free distance, in [m].
        obstacle_speed: Along the road, in [m/s]; oncoming counts as standing.
        braking: a, in [m/s^2].
    """
    lead = braking * SPEED_RESPONSE
    return max(obstacle_speed, 0.0) + math.sqrt(lead * lead + 2.0 * braking * max(distance, 0.0)) - lead
