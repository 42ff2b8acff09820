"""Step halving: what of a model's error is the plant's own numerics.

Of an FMU from elsewhere only the communication step can be halved. Where its answers do not change with that, its own
step did not change either (or it makes steps of one size only), and halving shows nothing.
"""

import math
from dataclasses import dataclass

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.open_loop import drive
from sidestep.validation.model_error.envelope import cell_manoeuvres
from sidestep.validation.model_error.prediction_error import prediction_errors, statistics
from sidestep.validation.model_error.prediction_models import MODELS

SUBSTEPS = {"mujoco": (10, 20), "single-track": (3, 6), "double-track": (3, 6), "linear": (5, 10)}
"""Plant steps per sample that are its own integration steps, and half of them; (1, 2) of an FMU from elsewhere."""
LARGEST_SHARE = 0.01
UNCHANGED = 1e-9
"""Change of a foreign plant's errors that is rounding, in [m]."""


@dataclass(frozen=True)
class StepSize:
    """One model's figures at one cell; 95th percentiles of the lateral error at the horizon's end.

    Attributes:
        model: One of MODELS.
        model_error: Against the plant, in [m].
        numerical_error: Change of the errors when the plant's step is halved, in [m]; NaN where its own step is not.
    """

    model: str
    model_error: float
    numerical_error: float

    @property
    def passed(self) -> bool | None:
        """Whether the numerical error is below LARGEST_SHARE of the model's; None where that cannot be told."""
        return None if math.isnan(self.numerical_error) else self.numerical_error < LARGEST_SHARE * self.model_error


def step_halving(
    plant: Plant, kind: str, vehicle: VehicleParameters, speed: float, acceleration: float
) -> list[StepSize]:
    """Drive the manoeuvres of a cell with the plant's step and with half of it.

    Args:
        plant: To drive.
        kind: As in a scenario file.
        vehicle: The car as the models know it.
        speed, acceleration: Of the cell, in [m/s] and [m/s^2].
    """
    manoeuvres = cell_manoeuvres(speed, acceleration, 0.0)
    whole, half = SUBSTEPS.get(kind, (1, 2))
    coarse = [drive(plant, m, vehicle, substeps=whole) for m in manoeuvres]
    try:
        fine = [drive(plant, m, vehicle, substeps=half) for m in manoeuvres]
    except InputError:  # a foreign plant that makes steps of one size only
        if kind in SUBSTEPS:
            raise
        fine = coarse
    result = []
    for model in MODELS:
        errors, halved = ([prediction_errors(model, response, vehicle) for response in d] for d in (coarse, fine))
        change = float(statistics([b - a for a, b in zip(errors, halved, strict=True)]).p95[-1, 0])
        shows = kind in SUBSTEPS or change > UNCHANGED
        result.append(StepSize(model, float(statistics(errors).p95[-1, 0]), change if shows else math.nan))
    return result
