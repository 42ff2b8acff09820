"""Distance from the car to the nearest obstacle, as boxes on the road."""

import math

from sidestep.plant_models.kernels import Array, Record, Records, kernel
from sidestep.plant_models.road.clothoid import point_at

NOTHING_NEAR = 1000.0
"""Clearance where there is no obstacle, in [m]."""


@kernel
def clearance(setups: Records, table: Array, boxes: Array, states: Records) -> float:
    """Distance in [m] from the car to the nearest obstacle, 0 if they overlap, at most `NOTHING_NEAR`.

    Args:
        setups: Record of `SETUP`, shape (1,).
        table: Of the ReferencePath.
        boxes: s, l, length, width, heading and speed as they stood at time 0, shape (M, 6).
        states: Record of `STATE`, shape (1,).
    """
    setup, state, nearest = setups[0], states[0], NOTHING_NEAR
    for i in range(boxes.shape[0]):
        nearest = min(nearest, _to_box(setup, state, table, boxes[i]))
    return nearest


@kernel
def _to_box(setup: Record, state: Record, table: Array, box: Array) -> float:
    x, y, heading = point_at(table, setup.period, box[0] + box[5] * state.time, box[1])
    ahead = setup.ahead
    x_1, y_1 = state.x + ahead * math.cos(state.yaw), state.y + ahead * math.sin(state.yaw)
    return box_distance(
        x_1, y_1, state.yaw, setup.half_length, setup.half_width, x, y, heading + box[4], 0.5 * box[2], 0.5 * box[3]
    )


@kernel
def box_distance(
    x: float, y: float, heading: float, a: float, b: float,
    x_2: float, y_2: float, heading_2: float, a_2: float, b_2: float,
) -> float:  # fmt: skip
    """Distance in [m] between two boxes, 0 if they overlap.

    Args:
        x, y, heading: Centre and direction of the first, in [m] and [rad].
        a, b: Half its length and width, in [m].
        x_2, y_2, heading_2, a_2, b_2: The same of the second.
    """
    first, apart = _corner_distance(x, y, heading, a, b, x_2, y_2, heading_2, a_2, b_2)
    second, too = _corner_distance(x_2, y_2, heading_2, a_2, b_2, x, y, heading, a, b)
    return min(first, second) if apart or too else 0.0


@kernel
def _corner_distance(x, y, heading, a, b, x_2, y_2, heading_2, a_2, b_2):
    """From the corners of the second box to the first one; whether an axis of the first one separates them."""
    c, s, turn = math.cos(heading), math.sin(heading), heading_2 - heading
    along, across = c * (x_2 - x) + s * (y_2 - y), c * (y_2 - y) - s * (x_2 - x)
    cos, sin = math.cos(turn), math.sin(turn)
    nearest = math.inf
    for i in (-1.0, 1.0):
        for j in (-1.0, 1.0):
            u, w = along + i * a_2 * cos - j * b_2 * sin, across + i * a_2 * sin + j * b_2 * cos
            nearest = min(nearest, math.hypot(max(abs(u) - a, 0.0), max(abs(w) - b, 0.0)))
    reach_u, reach_w = a_2 * abs(cos) + b_2 * abs(sin), a_2 * abs(sin) + b_2 * abs(cos)
    return nearest, abs(along) > a + reach_u or abs(across) > b + reach_w
