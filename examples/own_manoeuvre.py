"""A manoeuvre of your own, on two plants: what the steering does is a dataclass, the rest is data."""

from dataclasses import dataclass

import numpy as np

from sidestep.plant_models import VehicleParameters
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.validation.manoeuvres.catalogue import Array, Manoeuvre
from sidestep.validation.manoeuvres.open_loop import drive
from sidestep.validation.report.compare.rating import rate


@dataclass(frozen=True)
class FishHook:
    """To one side, then twice as far to the other; both over `rise` [s]."""

    rise: float = 0.4

    def __call__(self, time: Array) -> Array:
        """Share of the amplitude."""
        return np.interp(time, [0.5, 0.5 + self.rise, 1.2, 1.2 + 2.0 * self.rise], [0.0, 0.5, 0.5, -1.0])


car = VehicleParameters.preset("bmw-320i")
manoeuvre = Manoeuvre("fish-hook", FishHook(), speed=18.0, lateral_acceleration=5.0, duration=4.0)
linear, mujoco = (drive(plant, manoeuvre, car) for plant in (LinearPlant(car), MujocoPlant(car)))
for signal in ("yaw_rate", "lateral_acceleration"):
    rating = rate(linear[signal], mujoco[signal])
    print(f"{signal:22}{rating.overall:.3f} {rating.grade}")
