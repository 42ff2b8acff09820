"""Validity envelope: up to which lateral acceleration a model predicts a plant, by speed and friction.

A cell is a speed, a friction and a commanded lateral acceleration. In each, three manoeuvres are driven: a step, a
sine, and a sine with dwell. On a straight road all of the acceleration is the manoeuvre's; on a curved one half of it
is the bend's, unless that is narrower than NARROWEST. The figure of a cell is the 95th percentile of |l_s| error at the
end of HORIZON_TIME, over all starting points of the three. A model is valid up to the acceleration at which this
reaches the buffer of the corridor: beyond, its error alone can eat up the clearance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.mpc.car_model import Car, axle_force, peak_slip
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.manoeuvres.catalogue import Manoeuvre, Ramp, Sine
from sidestep.validation.manoeuvres.open_loop import drive
from sidestep.validation.manoeuvres.scene import open_loop_scenario
from sidestep.validation.model_error.prediction_error import HORIZON_TIME, prediction_errors, statistics
from sidestep.validation.model_error.prediction_models import MODELS
from sidestep.validation.scenarios.scenario import Scenario
from sidestep.validation.studies.limits import in_parallel

Array = NDArray[np.float64]

ROADS = ("straight", "curved")
FRICTIONS = (1.0, 0.6, 0.3)
SHARES = tuple(np.linspace(0.12, 0.96, 8).tolist())
"""Commanded lateral accelerations, as shares of what the tyres hold."""
SPEEDS = tuple(np.linspace(5.0, 35.0, 13).tolist())
"""In [m/s]."""
NARROWEST = 20.0
"""Least radius of the curved road, in [m]."""
DURATION = 4.0
"""Of each manoeuvre, in [s]."""
_SHAPES = (Ramp(), Sine(0.5), Sine(0.7, dwell=0.5))


@dataclass(frozen=True, eq=False)
class Envelope:
    """What came out.

    Attributes:
        plant: Its name.
        speeds, frictions: Of the cells, shapes (s,) and (f,), in [m/s] and [-].
        accelerations: Commanded, shape (f, a), in [m/s^2].
        tyre_limits: Lateral acceleration that the tyres hold, shape (f,), in [m/s^2].
        errors: 95th percentiles, shape (roads, models, f, s, a), in [m]; NaN where the plant gave up.
        buffer: Of the corridor, in [m].
    """

    plant: str
    speeds: Array
    frictions: Array
    accelerations: Array
    tyre_limits: Array
    errors: Array
    buffer: float

    @property
    def cells(self) -> int:
        """Speeds, frictions and accelerations, per road."""
        return len(self.speeds) * self.accelerations.size

    def largest(self) -> Array:
        """Acceleration up to which the error stays within the buffer, shape (roads, models, f, s), in [m/s^2]."""
        result = np.empty(self.errors.shape[:-1])
        for index in np.ndindex(result.shape):
            result[index] = crossing(self.accelerations[index[2]], self.errors[index], self.buffer)
        return result

    def as_tables(self) -> dict[str, Any]:
        """For a JSON file: what `controller.validity` reads (the narrower of both roads), and the errors behind."""
        limits = self.largest().min(axis=0)
        return {
            "plant": self.plant,
            "buffer": self.buffer,
            "horizon": HORIZON_TIME,
            "speed": self.speeds.tolist(),
            "friction": self.frictions.tolist(),
            "max_lateral_acceleration": dict(zip(MODELS, limits.tolist(), strict=True)),
            "lateral_acceleration": self.accelerations.tolist(),
            "p95_error": {
                road: dict(zip(MODELS, errors.tolist(), strict=True))
                for road, errors in zip(ROADS, self.errors, strict=True)
            },
        }


def frictions_of(scenario: Scenario) -> tuple[float, ...]:
    """Those that the plant can be driven on; an FMU from elsewhere needs a parameter `friction`.

    Raises:
        InputError: The plant cannot be used, or is asked for on one friction alone.
        PlantError: It cannot be built.
    """
    if (friction := scenario.plant.friction) != FRICTIONS[0]:
        raise InputError("plant.friction", f"{friction}: the envelope is driven on {FRICTIONS}", f"{FRICTIONS[0]}")
    open_plant(scenario).close()
    try:
        open_with_friction(scenario, FRICTIONS[1]).close()
    except InputError:
        return FRICTIONS[:1]
    return FRICTIONS


def open_with_friction(scenario: Scenario, friction: float) -> Plant:
    """The scenario's plant on a road of this friction."""
    return open_plant(replace(scenario, plant=replace(scenario.plant, friction=friction)))


def tyre_limit(vehicle: VehicleParameters, friction: float) -> float:
    """Steady lateral acceleration at which the first axle slides, in [m/s^2]."""
    car = Car.of(vehicle, affine=True, friction=friction)
    return GRAVITY * min(
        axle_force(peak_slip(stiffness, load, car), stiffness, load, car) / load
        for stiffness, load in ((car.stiffness_f, car.load_f), (car.stiffness_r, car.load_r))
    )


def envelope(
    overrides: Sequence[str],
    jobs: int = -1,
    speeds: Sequence[float] = SPEEDS,
    shares: Sequence[float] = SHARES,
) -> Envelope:
    """Drive all cells.

    Args:
        overrides: `key=value` of plant, vehicle and controller.buffer, as given to `--set`.
        jobs: Processes, -1 for one per core.
        speeds: In [m/s].
        shares: Of what the tyres hold.

    Raises:
        InputError, PlantError: The plant cannot be built.
    """
    scenario = open_loop_scenario(overrides)
    frictions = frictions_of(scenario)
    limits = np.array([tyre_limit(scenario.vehicle, friction) for friction in frictions])
    accelerations = np.outer(limits, shares)
    calls = [
        partial(_column, tuple(overrides), friction, speed, row)
        for friction, row in zip(frictions, accelerations.tolist(), strict=True)
        for speed in speeds
    ]
    columns = np.array(in_parallel(f"envelope of {scenario.plant.name}", calls, jobs))
    errors = columns.reshape(len(frictions), len(speeds), len(ROADS), len(MODELS), -1).transpose(2, 3, 0, 1, 4)
    return Envelope(
        scenario.plant.name, np.array(speeds), np.array(frictions), accelerations, limits, errors,
        scenario.controller.buffer,
    )  # fmt: skip


def _column(overrides: Sequence[str], friction: float, speed: float, accelerations: Sequence[float]) -> Array:
    """Errors of the cells of one friction and speed, shape (roads, models, a)."""
    scenario = open_loop_scenario(overrides)
    result = np.full((len(ROADS), len(MODELS), len(accelerations)), np.nan)
    with open_with_friction(scenario, friction) as plant:
        for i, acceleration in enumerate(accelerations):
            for road, bend in enumerate((0.0, min(0.5 * acceleration, speed**2 / NARROWEST))):
                drives = cell_manoeuvres(speed, acceleration, bend)
                try:
                    result[road, :, i] = cell_errors(plant, scenario.vehicle, friction, drives)
                except PlantError:
                    continue
    return result


def cell_manoeuvres(speed: float, acceleration: float, bend: float) -> list[Manoeuvre]:
    """The three of a cell: `acceleration` [m/s^2] in all, `bend` [m/s^2] of it the road's."""
    return [Manoeuvre("envelope", shape, speed, acceleration - bend, DURATION, bend) for shape in _SHAPES]


def cell_errors(
    plant: Plant, vehicle: VehicleParameters, friction: float, manoeuvres: Sequence[Manoeuvre], substeps: int = 1
) -> Array:
    """95th percentile of every model's lateral error at the horizon's end, shape (models,), in [m].

    Raises:
        PlantError: The plant cannot go on.
    """
    drives = [(drive(plant, m, vehicle, substeps=substeps), m.bend / m.speed**2) for m in manoeuvres]
    return np.array([
        statistics([prediction_errors(model, response, vehicle, friction, curvature) for response, curvature in drives])
        .p95[-1, 0]
        for model in MODELS
    ])  # fmt: skip


def crossing(accelerations: Array, errors: Array, buffer: float) -> float:
    """Where errors over rising accelerations first leave the buffer; from (0, 0) on, linear between cells."""
    x, y = np.concatenate([[0.0], accelerations]), np.concatenate([[0.0], errors])
    beyond = np.flatnonzero(~(y <= buffer))
    if len(beyond) == 0:
        return float(x[-1])
    k = int(beyond[0])
    if not np.isfinite(y[k]):
        return float(x[k - 1])
    return float(np.interp(buffer, y[k - 1 : k + 1], x[k - 1 : k + 1]))
