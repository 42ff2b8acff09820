"""Stopping before what blocks the road: how fast the car may still be."""

import math

SPEED_RESPONSE = 0.5
"""Response time assumed of the plant's speed control, in [s]."""


def braking_needed(speed: float, obstacle_speed: float, distance: float, comfort: float, limit: float) -> float:
    """Deceleration that stops in time: comfortable where that is enough, up to the limit where not, in [m/s^2]."""
    closing = max(speed - obstacle_speed, 0.0)
    room = max(distance - closing * SPEED_RESPONSE, 0.1)
    return min(max(closing * closing / (2.0 * room), comfort), limit)


def approach_speed(distance: float, obstacle_speed: float, braking: float) -> float:
    """Target speed at a distance before an obstacle.

    Braking at a constant rate towards the obstacle's speed, commanded early by the response time tau of a
    first-order speed control: v = v_o + sqrt(a^2 tau^2 + 2 a d) - a tau.

    Args:
        distance: Free distance, in [m].
        obstacle_speed: Along the road, in [m/s]; oncoming counts as standing.
        braking: a, in [m/s^2].
    """
    lead = braking * SPEED_RESPONSE
    return max(obstacle_speed, 0.0) + math.sqrt(lead * lead + 2.0 * braking * max(distance, 0.0)) - lead
