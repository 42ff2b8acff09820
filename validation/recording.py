"""What a run leaves behind: signals every plant step, one row per controller step, the plans."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidestep.validation.files import complete

Array = NDArray[np.float64]

SAMPLE_UNITS = {
    "time": "s",
    "x": "m",
    "y": "m",
    "yaw": "rad",
    "v_x": "m/s",
    "v_y": "m/s",
    "yaw_rate": "rad/s",
    "steer_angle": "rad",  # realised
    "s": "m",
    "l": "m",
    "heading_error": "rad",
    "steer_command": "rad",  # as the controller gave it
    "steer_received": "rad",  # as it came off the bus, held over the step that begins here
    "target_speed": "m/s",
    "status": "-",
    "lateral_acceleration": "m/s^2",
    "steer_rate": "rad/s",
}
"""Columns of `recording.csv` and their units."""

STEP_UNITS = {
    "time": "s",
    "status": "-",
    "feasible": "-",
    "iterations": "-",
    "primal_residual": "-",
    "dual_residual": "-",
    "slack_corridor": "m",
    "slack_slip": "rad",
    "stop_distance": "m",
    "plan_time": "us",
    "build_time": "us",
    "solve_time": "us",
    "step_time": "us",  # of the whole call, as the loop sees it
}
"""Columns of `steps.csv`, one row per controller step, and their units."""


class End(Enum):
    """Why a run ended."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    END_OF_ROAD = "end of the road"
    INTERRUPTED = "interrupted"
    PLANT_INVALID = "plant invalid"
    CONTROLLER_ERROR = "controller error"
    BUS_ERROR = "bus error"


@dataclass(frozen=True)
class Recording:
    """A run, complete up to where it ended.

    Attributes:
        samples: Columns of `SAMPLE_UNITS`, shape (n,), one row per plant step and one for the last state.
        steps: Columns of `STEP_UNITS`, shape (k,).
        plans: The controller's plan of every step.
        end: Why the run ended.
        error: What was raised, if that ended it.
        wall_time: Real time that the loop took, in [s].
        contact: Whether the plant says that it touched an obstacle (its attribute `collided`, if it has one).
        estimated: Samples that the plant does not report but estimates (its attribute `estimated`, if it has one).
    """

    samples: Mapping[str, Array]
    steps: Mapping[str, Array]
    plans: Sequence[Any] = ()
    end: End = End.COMPLETED
    error: BaseException | None = None
    wall_time: float = 0.0
    contact: bool = False
    estimated: tuple[str, ...] = ()

    def __getitem__(self, column: str) -> Array:
        return self.samples[column]

    @property
    def units(self) -> dict[str, str]:
        """Of `samples`; those that the plant estimates are marked."""
        return {name: f"{unit}, estimated" if name in self.estimated else unit for name, unit in SAMPLE_UNITS.items()}

    @property
    def infeasible_steps(self) -> int:
        """Controller steps without a feasible problem: solver failed, or corridor slack above 1 mm."""
        return int(np.count_nonzero(self.steps["feasible"] == 0.0))


def write_columns(file: Path, columns: Mapping[str, Array], units: Mapping[str, str]) -> None:
    """Write a CSV with units in its header; the file is there complete or not at all."""
    with complete(file) as stream:
        writer = csv.writer(stream)
        writer.writerow(f"{name} [{units[name]}]" for name in columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))


def read_columns(file: Path) -> dict[str, Array]:
    """The columns of such a CSV by name, without their units."""
    with file.open(newline="", encoding="utf-8") as stream:
        rows = csv.reader(stream)
        names = [name.partition(" [")[0] for name in next(rows)]
        values = np.array(list(rows), dtype=float).reshape(-1, len(names))
    return {name: values[:, i] for i, name in enumerate(names)}
