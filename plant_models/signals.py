"""The signals that cross every seam: what a plant reports and what it is commanded.

ISO 8855 axes (x forward, y left, yaw and steering positive to the left), SI units, radians.
The reference point is the ground projection of the total centre of gravity, rotated by yaw only.
"""

import math
from dataclasses import dataclass, field
from enum import IntEnum


class Status(IntEnum):
    """How far a steering command can be trusted; the higher, the worse."""

    TRACKING = 0  # the optimum of this step
    DEGRADED = 1  # soft limits in use, or the shifted plan of an earlier step
    BLOCKED = 2  # no way past the obstacles: target_speed falls so that the car stops before them
    FAULT = 3  # no usable plan or input: angle held, target_speed falls to zero


@dataclass(frozen=True, slots=True)
class VehicleState:
    """State of the car at one instant.

    Attributes:
        time: Time, in [s].
        x, y: Position of the reference point in the world, in [m].
        yaw: Heading, in [rad]; continuous, not wrapped.
        v_x, v_y: Velocity of the reference point along the yawed axes, in [m/s].
        yaw_rate: Yaw rate gamma, in [rad/s].
        steer_angle: Realised road-wheel angle, in [rad].
    """

    time: float = 0.0
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    v_x: float = 0.0
    v_y: float = 0.0
    yaw_rate: float = 0.0
    steer_angle: float = 0.0

    def is_finite(self) -> bool:
        """Whether every signal is a finite number."""
        return math.isfinite(
            self.time + self.x + self.y + self.yaw + self.v_x + self.v_y + self.yaw_rate + self.steer_angle
        )


@dataclass(frozen=True, slots=True)
class SteeringCommand:
    """What the controller asks for until its next step.

    Attributes:
        time: Time of the state that it answers, in [s].
        steer_angle: Road-wheel angle, in [rad].
        target_speed: Speed to hold, in [m/s]; falls below the present speed when the road is blocked. For plants that
            know nothing else, and where no acceleration is given.
        status: How far the command can be trusted.
        acceleration: Wanted now, in [m/s^2], of the speed along the road; negative is braking, which never drives the
            car backwards and holds it at standstill. NaN if it is not given: then the target speed counts. By name
            only: whoever gives time, angle, speed and status by place goes on saying the same.
    """

    time: float
    steer_angle: float
    target_speed: float
    status: Status = Status.TRACKING
    acceleration: float = field(default=math.nan, kw_only=True)
