"""How far the prediction may be trusted: the largest lateral acceleration by speed and friction.

`sidestep validate` writes it as validity.json: a table for each prediction model, measured against a plant.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.mpc.car_model import axle_force
from sidestep.plant_models.documents import read_json
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import Record, kernel
from sidestep.plant_models.vehicle.parameters import GRAVITY

Array = NDArray[np.float64]

SLIP_ACCURACY = 1e-5
"""Of the slip angle at which an axle makes a given force, in [rad]."""


@dataclass(frozen=True, eq=False)
class Validity:
    """Limits of one model.

    Attributes:
        speeds: Rising, shape (s,), in [m/s].
        frictions: Rising, shape (f,).
        limits: Lateral acceleration, shape (f, s), in [m/s^2].
    """

    speeds: Array
    frictions: Array
    limits: Array

    @classmethod
    def of(cls, config: ControllerConfig) -> "Validity | None":
        """What a configuration names, for its own prediction model; None if it names nothing.

        Raises:
            InputError: As of `from_file`.
        """
        if not config.validity:
            return None
        return cls.from_file(config.validity, "euler" if config.formulation == "paper" else config.tyre_model)

    @classmethod
    def from_file(cls, path: str | Path, model: str) -> "Validity":
        """Read the table of one model.

        Args:
            path: validity.json.
            model: "affine", "linear" or "euler".

        Raises:
            InputError: The file cannot be read, or does not hold such a table.
        """
        data = read_json(path, "a file of `sidestep validate`")
        try:
            speeds, frictions = (np.array(data[name], dtype=np.float64) for name in ("speed", "friction"))
            limits = np.array(data["max_lateral_acceleration"][model], dtype=np.float64)
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise InputError(
                "controller.validity", f"{str(path)!r}: {error}", "a file of `sidestep validate`"
            ) from error
        if problem := _problem(speeds, frictions, limits):
            raise InputError("controller.validity", f"{str(path)!r}: {problem}", "a file of `sidestep validate`")
        order = np.argsort(frictions)
        return cls(speeds, frictions[order], limits[order])

    def by_speed(self, friction: float) -> Array:
        """Limits at `speeds` on a road of this friction, in [m/s^2]; held beyond the table's ends."""
        return np.array([np.interp(friction, self.frictions, column) for column in self.limits.T])


@kernel
def slip_limits(speed: float, w: Record, c: Record) -> None:
    """Bounds of front and rear slip angle at a speed [m/s], within what the prediction is valid for, in [rad].

    Args:
        speed: v, in [m/s].
        w: Work space; `slip_limits` is filled.
        c: Settings: share of the peak, and the validity table.
    """
    car = c.car
    w.slip_limits[0], w.slip_limits[1] = c.slip_limits[0], c.slip_limits[1]
    if c.valid == 0:
        return
    share = np.interp(speed, c.valid_speeds[: c.valid], c.valid_accelerations[: c.valid]) / GRAVITY  # of the load
    front = _slip_of(share * car.load_f, car.stiffness_f, car.load_f, car, c.peaks[0])
    rear = _slip_of(share * car.load_r, car.stiffness_r, car.load_r, car, c.peaks[1])
    w.slip_limits[0], w.slip_limits[1] = min(c.slip_limits[0], front), min(c.slip_limits[1], rear)


def _problem(speeds: Array, frictions: Array, limits: Array) -> str:
    """Why the table of one model is not to be trusted; empty if it is."""
    if not (limits.size and speeds.ndim == frictions.ndim == 1 and limits.shape == (frictions.size, speeds.size)):
        return f"limits of shape {limits.shape} for {frictions.shape} frictions and {speeds.shape} speeds"
    if not (np.isfinite(speeds).all() and speeds[0] >= 0.0 and (np.diff(speeds) > 0.0).all()):
        return f"speeds that do not rise from 0 or more: {speeds.tolist()}"
    if not (np.isfinite(frictions) & (frictions > 0.0)).all():
        return f"a friction that is not positive: {frictions.tolist()}"
    rows = frictions.tolist()
    if twice := [friction for friction in rows if rows.count(friction) > 1]:
        return f"friction {twice[0]:g} stands in more than one row"  # which limit holds?
    if not (np.isfinite(limits) & (limits >= 0.0)).all():
        return "a limit that is negative or no number"
    return ""


@kernel
def _slip_of(force, stiffness, load, car, peak):
    """Smallest slip angle at which an axle makes a force, in [rad]; that of the peak if it never does."""
    if not car.affine:
        return force / stiffness
    low, high = 0.0, peak
    while high - low > SLIP_ACCURACY:
        middle = 0.5 * (low + high)
        if axle_force(middle, stiffness, load, car) < force:
            low = middle
        else:
            high = middle
    return high
