"""Open-loop manoeuvres as data: what the steering does, at which speed, for how long.

Each is after a standard ("19364-style": the standards' tolerances are not reproduced). Amplitudes are lateral
accelerations: the angle is the one that holds this acceleration steadily in the linear model of the car, so that the
same manoeuvre means the same for every car. To add one, add a `Manoeuvre` to MANOEUVRES; a new shape of the steering
is a dataclass with `__call__`.
"""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.vehicle.checks import GRAVITY

Array = NDArray[np.float64]


class Shape(Protocol):
    """Steering over time as a share of the amplitude."""

    def __call__(self, time: Array) -> Array:
        """Shares at times in [s], shape as `time`."""
        ...


@dataclass(frozen=True)
class Ramp:
    """From 0 at `start` to 1 within `rise`, then held; both in [s]."""

    start: float = 0.5
    rise: float = 0.15

    def __call__(self, time: Array) -> Array:
        """See Shape."""
        return np.clip((time - self.start) / self.rise, 0.0, 1.0)


@dataclass(frozen=True)
class Sine:
    """Sine of `frequency` [Hz] from `start` [s], for `cycles` periods, its third quarter held for `dwell` [s]."""

    frequency: float
    cycles: float = 1.0
    start: float = 0.5
    dwell: float = 0.0

    def __call__(self, time: Array) -> Array:
        """See Shape."""
        t = time - self.start
        held = 0.75 / self.frequency
        t = np.where(t > held, np.maximum(t - self.dwell, held), t)
        inside = (t >= 0.0) & (t <= self.cycles / self.frequency)
        return np.where(inside, np.sin(2.0 * math.pi * self.frequency * t), 0.0)


@dataclass(frozen=True)
class Sweep:
    """Sine whose frequency grows exponentially from `low` to `high` [Hz] within `duration` [s]."""

    low: float
    high: float
    duration: float

    def __call__(self, time: Array) -> Array:
        """See Shape."""
        growth = math.log(self.high / self.low) / self.duration
        return np.sin(2.0 * math.pi * self.low * np.expm1(growth * time) / growth)


@dataclass(frozen=True)
class Pulse:
    """Half a cosine wave from 0 to 1 and back, from `start` and `width` long; both in [s]."""

    start: float = 0.5
    width: float = 0.4

    def __call__(self, time: Array) -> Array:
        """See Shape."""
        share = np.clip((time - self.start) / self.width, 0.0, 1.0)
        return 0.5 * (1.0 - np.cos(2.0 * math.pi * share))


@dataclass(frozen=True)
class RandomSteer:
    """Sum of 64 sines between `low` and `high` [Hz] with random phases; standard deviation 1/3."""

    low: float
    high: float
    seed: int = 0

    def __call__(self, time: Array) -> Array:
        """See Shape."""
        frequency = np.linspace(self.low, self.high, 64)
        phase = np.random.default_rng(self.seed).uniform(0.0, 2.0 * math.pi, 64)
        waves = np.sin(2.0 * math.pi * np.multiply.outer(time, frequency) + phase)
        return waves.sum(axis=-1) * math.sqrt(2.0 / 64.0) / 3.0


@dataclass(frozen=True)
class Manoeuvre:
    """One open-loop drive on an empty plane.

    Attributes:
        name: Of its kind; several drives may share it.
        shape: Of the steering.
        speed: At the start, and to be held, in [m/s].
        lateral_acceleration: Amplitude, see the head of this module, in [m/s^2]; positive first to the left.
        duration: In [s].
        bend: Steady lateral acceleration that the steering swings about, from the start on, in [m/s^2].
        final_speed: To which the speed rises evenly; None to hold it, in [m/s].
        radius: Of a circle that the steering is corrected to stay on, in [m]; None for open loop.
        coasts: Neither driven nor braked.
    """

    name: str
    shape: Shape
    speed: float
    lateral_acceleration: float
    duration: float
    bend: float = 0.0
    final_speed: float | None = None
    radius: float | None = None
    coasts: bool = False

    @property
    def label(self) -> str:
        """Name, speed and amplitude, for tables."""
        speed = f"{self.speed:.3g}" + (f" to {self.final_speed:g}" if self.final_speed else "")
        amplitude = f", {self.lateral_acceleration:.3g} m/s²" if self.lateral_acceleration else ""
        return f"{self.name}, {speed} m/s{amplitude}"

    def mirrored(self) -> "Manoeuvre":
        """The same to the other side."""
        radius = -self.radius if self.radius else None
        return replace(self, lateral_acceleration=-self.lateral_acceleration, bend=-self.bend, radius=radius)


_A_03 = 0.3 * GRAVITY  # FMVSS 126 relates the amplitude to the angle at 0.3 g

MANOEUVRES: dict[str, tuple[Manoeuvre, ...]] = {
    manoeuvres[0].name: manoeuvres
    for manoeuvres in (
        (Manoeuvre("coast", Ramp(), 20.0, 0.0, 10.0, coasts=True),),
        (Manoeuvre("slowly-increasing-steer", Ramp(0.5, 20.0), 80.0 / 3.6, 8.0, 21.0),),
        (Manoeuvre("constant-radius", Ramp(), 8.0, 0.0, 40.0, final_speed=25.0, radius=100.0),),
        tuple(
            Manoeuvre("step-steer", Ramp(), speed, amplitude, 5.0)
            for speed in (15.0, 20.0, 25.0)
            for amplitude in (1.0, 2.0, 4.0, 6.0)
        ),
        tuple(Manoeuvre("sine-sweep", Sweep(0.1, 4.0, 40.0), 20.0, amplitude, 40.0) for amplitude in (0.5, 2.0, 4.0)),
        (Manoeuvre("single-sine", Sine(0.5), 20.0, 4.0, 5.0),),
        (Manoeuvre("weave", Sine(0.2, cycles=6.0), 100.0 / 3.6, 2.0, 30.0),),
        (Manoeuvre("pulse", Pulse(), 80.0 / 3.6, 4.0, 4.0),),
        tuple(
            Manoeuvre("sine-with-dwell", Sine(0.7, dwell=0.5), 80.0 / 3.6, multiple * _A_03, 5.0)
            for multiple in np.arange(1.5, 7.0, 0.5)
        ),
        (Manoeuvre("random-steer", RandomSteer(0.2, 3.0), 20.0, 3.0, 60.0),),
    )
}
"""Every open-loop manoeuvre by name, with its drives."""
