"""What a run leaves behind: signals every plant step, one row per controller step, the plans."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.documents import file_text
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.notebook import facts_table
from sidestep.validation.files import complete
from sidestep.validation.loop.start import Departure

if TYPE_CHECKING:
    from pandas import DataFrame

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
    "acceleration": "m/s^2",  # as commanded and received; nan for none
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
    "solve_time": "us",
    "step_time": "us",  # of the whole call, as the loop sees it
}
"""Columns of `steps.csv`, one row per controller step, and their units."""


class End(Enum):
    """Why a run ended."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    END_OF_ROAD = "end of the road"
    GOAL = "goal reached"
    INTERRUPTED = "interrupted"
    PLANT_INVALID = "plant invalid"
    CONTROLLER_ERROR = "controller error"
    BUS_ERROR = "bus error"


_CSV = "a CSV of numbers as sidestep wrote it"


@dataclass(frozen=True, repr=False)
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
        departures: What of the start the plant did not take, where that was accepted.
    """

    samples: Mapping[str, Array]
    steps: Mapping[str, Array]
    plans: Sequence[Any] = ()
    end: End = End.COMPLETED
    error: BaseException | None = None
    wall_time: float = 0.0
    contact: bool = False
    estimated: tuple[str, ...] = ()
    departures: tuple[Departure, ...] = ()

    def __getitem__(self, column: str) -> Array:
        return self.samples[column]

    def __repr__(self) -> str:
        rows, end = len(self.samples["time"]), self.end.value
        return f"Recording({self.samples['time'][-1]:.2f} s, {rows} samples, {len(self.plans)} plans, {end})"

    def _repr_html_(self) -> str:
        ranges = [
            (f"{name} [{self.units[name]}]", f"{values.min():.4g} to {values.max():.4g}")
            for name, values in self.samples.items()
        ]
        return facts_table(repr(self), ranges)

    def to_pandas(self) -> "DataFrame":
        """The samples as a table of pandas, a column a signal; `attrs["units"]` has the columns' units.

        Raises:
            InputError: pandas is not installed.
        """
        try:
            from pandas import DataFrame
        except ImportError as error:
            raise InputError("to_pandas", "pandas is not installed", "pip install 'sidestep[pandas]'") from error
        table = DataFrame(dict(self.samples))
        table.attrs["units"] = self.units
        return table

    @property
    def units(self) -> dict[str, str]:
        """Of `samples`; those that the plant estimates are marked."""
        return {name: f"{unit}, estimated" if name in self.estimated else unit for name, unit in SAMPLE_UNITS.items()}

    @property
    def infeasible_steps(self) -> int:
        """Controller steps without a feasible problem: solver failed, or corridor slack above 1 mm."""
        return int(np.count_nonzero(self.steps["feasible"] == 0.0))


_LONGEST = 1.1e5  # s; a scenario takes 1e5 at most


def write_columns(file: Path, columns: Mapping[str, Array], units: Mapping[str, str], note: str = "") -> None:
    """Write a CSV with units in its header, after a line `# note` if there is one; complete or not there."""
    with complete(file) as stream:
        stream.write(f"# {note}\n" if note else "")
        writer = csv.writer(stream)
        writer.writerow(f"{name} [{units[name]}]" for name in columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))


def read_columns(file: Path) -> dict[str, Array]:
    """The columns of such a CSV by name, without their units.

    Raises:
        InputError: It cannot be read, is cut short, or holds something else.
    """
    lines = file_text(file, _CSV).splitlines(keepends=True)
    if not lines or not lines[-1].endswith("\n"):
        raise InputError(str(file), f"is cut short in line {max(len(lines), 1)}", _CSV)
    head, *rows = csv.reader(line for line in lines if not line.startswith("#"))
    for number, row in enumerate(rows, len(lines) - len(rows) + 1):
        if len(row) != len(head):
            raise InputError(str(file), f"has {len(row)} values in line {number}, not {len(head)}", _CSV)
    try:
        values = np.array(rows, dtype=float).reshape(-1, len(head))
    except ValueError as error:
        raise InputError(str(file), f"holds something else ({error})", _CSV) from error
    return {name.partition(" [")[0]: values[:, i] for i, name in enumerate(head)}


def require_times(time: Array, where: str) -> None:
    """Refuse times that no run has: what is drawn and compared is made anew on a grid of them.

    Raises:
        InputError: They do not rise, are not finite, or go on for longer than a scenario may.
    """
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all() and time[-1] - time[0] <= _LONGEST):
        raise InputError(f"{where}: time", "does not rise, or goes on for too long", f"up to {_LONGEST:g} s")
