"""Drivers that only brake, as a yardstick: who does not collide where they do not either is at least as careful.

Published models, in the lane that the car starts in and at the speed that it holds:

- "careful": the careful driver of UN R157 (annex 4, appendix 3), with the constants of the JRC's implementation
  (github ec-jrc/JRC-FSM, CC_human_driver): a vehicle that overlaps with the car's way, at a time to collision of 2 s at
  most, or that brakes by more than 5 m/s^2 there, is answered after 0.75 s, in which the pedal is left (0.4 m/s^2), by
  braking that builds up by 12.65 m/s^3 to 0.774 g. For what stands on the road the regulation has no model: it is seen
  as late as that here.
- "performance": the cut-in requirement of UN R157, 5.2.5.2: a time to collision of v_rel / (2 6 m/s^2) + 0.35 s + 0.1 s
  at 0.5 m beside the car is answered after 0.35 s by 6 m/s^2.
- "RSS": Shalev-Shwartz, Shammah and Shashua (2017) with the JRC's constants: 0.75 s, 3 and 6 m/s^2 along, 1 m/s^2
  across, 0.3 m.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sidestep.plant_models.vehicle.parameters import GRAVITY
from sidestep.validation.scenarios.scenario import Scenario

STEP = 0.01
"""Of their simulation, in [s]."""


@dataclass(frozen=True)
class Sight:
    """What a driver sees of one vehicle.

    Attributes:
        gap: Ahead, between bumpers, in [m]; negative beside or behind.
        beside: Between the sides, in [m]; negative where they overlap.
        speed: Of the car, in [m/s].
        other: Of the vehicle along the road, in [m/s].
        across: Of the vehicle across the road, its magnitude, in [m/s].
        braking: Of the vehicle, in [m/s^2].
    """

    gap: float
    beside: float
    speed: float
    other: float
    across: float
    braking: float

    @property
    def time_to_collision(self) -> float:
        """In [s]; infinite if it does not come nearer."""
        closing = self.speed - self.other
        return max(self.gap, 0.0) / closing if closing > 1e-6 else math.inf


@dataclass(frozen=True)
class Driver:
    """A model.

    Attributes:
        sees_risk: Whether it has to react.
        delay: Until it brakes, in [s].
        release: Deceleration meanwhile, in [m/s^2].
        jerk: With which braking builds up, in [m/s^3].
        braking: At most, in [m/s^2].
    """

    sees_risk: Callable[[Sight], bool]
    delay: float
    release: float
    jerk: float
    braking: float


def _careful(sight: Sight) -> bool:
    return sight.beside <= 0.0 and (sight.time_to_collision <= 2.0 or sight.braking > 5.0)


def _performance(sight: Sight) -> bool:
    limit = max(sight.speed - sight.other, 0.0) / (2.0 * 6.0) + 0.35 + 0.1
    return sight.beside <= 0.5 and sight.time_to_collision <= limit


def _rss(sight: Sight) -> bool:
    reaction, accelerating, braking, across = 0.75, 3.0, 6.0, 1.0
    faster = sight.speed + reaction * accelerating
    along = sight.speed * reaction + 0.5 * accelerating * reaction**2 + (faster**2 - sight.other**2) / (2.0 * braking)
    sideways = sight.across + across * reaction
    apart = 0.3 + 0.5 * (sight.across + sideways) * reaction + sideways**2 / (2.0 * across)
    return sight.gap < along and sight.beside < apart


DRIVERS = {
    "careful": Driver(_careful, 0.75, 0.4, 12.65, 0.774 * GRAVITY),
    "performance": Driver(_performance, 0.35, 0.0, math.inf, 6.0),
    "RSS": Driver(_rss, 0.75, 0.0, 12.65, 0.774 * GRAVITY),
}
"""By name."""


def smallest_gap(scenario: Scenario, driver: Driver) -> float:
    """Closest approach of a driver in a scenario, in [m]: 0 if it collides, infinite without obstacles."""
    vehicle, path = scenario.vehicle, scenario.path
    s, l, _ = path.project(scenario.start.x, scenario.start.y)  # noqa: E741 (the paper's letter)
    times = np.arange(0.0, scenario.duration, STEP)
    tracks = [_track(obstacle, times) for obstacle in scenario.obstacles]
    middle = 0.5 * (vehicle.front_extent - vehicle.rear_extent)
    speed, since, deceleration, smallest = scenario.start.v_x, math.inf, 0.0, math.inf
    for k, time in enumerate(times.tolist()):
        sights = [_sight(track[:, k], s + middle, l, speed, vehicle.length, vehicle.width) for track in tracks]
        for sight, back in sights:
            apart = math.hypot(max(sight.gap, back, 0.0), max(sight.beside, 0.0))
            smallest = min(smallest, apart)
        if smallest <= 0.0:
            return 0.0
        if since == math.inf and any(sight.gap > 0.0 and driver.sees_risk(sight) for sight, _ in sights):
            since = time
        if since != math.inf:
            late = time - since >= driver.delay
            deceleration = min(deceleration + driver.jerk * STEP, driver.braking) if late else driver.release
        following = max(speed - deceleration * STEP, 0.0)
        s, speed = s + 0.5 * (speed + following) * STEP, following
    return smallest


def _track(obstacle, times: np.ndarray) -> np.ndarray:
    """Rows of s, l, speeds along and across, braking, half lengths along and across, shape (7, n)."""
    s, l, heading, _ = obstacle.track(times)  # noqa: E741
    along, across = np.gradient(s, times), np.gradient(l, times)
    c, d = np.abs(np.cos(heading)), np.abs(np.sin(heading))
    half, wide = (0.5 * (obstacle.length * a + obstacle.width * b) for a, b in ((c, d), (d, c)))
    braking = -np.gradient(np.convolve(along, np.ones(9) / 9.0, mode="same"), times)
    braking[:9], braking[-9:] = 0.0, 0.0
    s = np.where(obstacle.is_there(times), s, -1e7)
    return np.stack([s, l, along, np.abs(across), braking, half, wide])


def _sight(row: np.ndarray, s: float, l: float, speed: float, length: float, width: float) -> tuple[Sight, float]:  # noqa: E741
    """What is seen of it, and the gap behind the car."""
    other_s, other_l, along, across, braking, half, wide = row.tolist()
    reach = half + 0.5 * length
    beside = abs(other_l - l) - wide - 0.5 * width
    return Sight(other_s - s - reach, beside, speed, along, across, braking), s - other_s - reach
