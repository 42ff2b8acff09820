"""What a vehicle's interface lets pass: angle, rate, and the lateral acceleration and jerk that follow from them.

Of a slow turn: acceleration = speed^2 tan(angle) / wheelbase, and jerk = speed^2 rate / wheelbase.
"""

from dataclasses import dataclass
from math import atan, inf

from sidestep.controller.can_port.codec.mapping import Limits

_SLOWEST = 1.0  # m/s; below it a turn has no lateral acceleration to speak of


@dataclass(frozen=True)
class Interface:
    """Limits of an interface for one car.

    Attributes:
        limits: Those of the mapping file.
        wheelbase: Of the car, in [m].
    """

    limits: Limits
    wheelbase: float

    def highest(self, speed: float) -> float:
        """Largest road-wheel angle at a speed, in [rad]."""
        angle, acceleration = self.limits.angle or inf, self.limits.lateral_acceleration
        if acceleration is None:
            return angle
        return min(angle, atan(acceleration * self.wheelbase / max(speed, _SLOWEST) ** 2))

    def rate(self, speed: float) -> float:
        """Largest road-wheel rate at a speed, in [rad/s]."""
        rate, jerk = self.limits.rate or inf, self.limits.lateral_jerk
        return rate if jerk is None else min(rate, jerk * self.wheelbase / max(speed, _SLOWEST) ** 2)

    def limited(self, angle: float, last: float, speed: float, elapsed: float) -> float:
        """The nearest angle that passes so long after `last`."""
        reach, highest = self.rate(speed) * elapsed, self.highest(speed)
        return min(max(min(max(angle, last - reach), last + reach), -highest), highest)

    def passes(self, angle: float, last: float, speed: float, elapsed: float, tolerance: float) -> bool:
        """Whether an angle passes, give or take what a signal rounds."""
        near = abs(angle - last) <= self.rate(speed) * elapsed + tolerance
        return near and abs(angle) <= self.highest(speed) + tolerance
