"""Golden recordings: what a run of the same scenario has to stay close to, within a funnel in time and value."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from sidestep.plant_models.errors import InputError
from sidestep.validation.files import written_file
from sidestep.validation.loop.recording import SAMPLE_UNITS, Array, read_columns, require_times, write_columns

TOLERANCES = {"l": 0.02, "yaw_rate": 0.01, "lateral_acceleration": 0.15, "steer_angle": 0.003}
"""Half height of the funnel about each signal, in [m], [rad/s], [m/s^2], [rad]."""
TIME_TOLERANCE = 0.03
"""How much earlier or later a signal may do what it does, in [s]."""
_HEAD = "golden recording of "
PERIOD = 0.01
"""Of the samples that are compared, in [s]."""


@dataclass(frozen=True, eq=False)
class Funnel:
    """Bounds about a reference: its extremes within `TIME_TOLERANCE`, and a tolerance beyond.

    Attributes:
        time: Shape (n,), in [s].
        low, high: Shape (n,), in the signal's unit.
    """

    time: Array
    low: Array
    high: Array

    def excess(self, time: Array, values: Array) -> Array:
        """How far a signal is outside, shape (n,); it counts as outside where it is not there any more."""
        values = np.interp(self.time, time, values)
        beyond = np.maximum(np.maximum(values - self.high, self.low - values), 0.0)
        gone = (self.time < time[0] - PERIOD / 2.0) | (self.time > time[-1] + PERIOD / 2.0)
        return np.where(gone, np.inf, beyond)


@dataclass(frozen=True)
class Departure:
    """One signal beside its funnel.

    Attributes:
        signal: Column of the recording.
        worst: Largest distance outside, in its unit; 0 if it stays within, infinite if it ends too early.
        time: When that is, in [s].
    """

    signal: str
    worst: float
    time: float

    @property
    def passed(self) -> bool:
        """Whether the signal stays within its funnel."""
        return self.worst == 0.0

    def __str__(self) -> str:
        if self.passed:
            return f"{self.signal}: within its funnel"
        how_far = "has ended" if np.isinf(self.worst) else f"is {self.worst:.3g} {SAMPLE_UNITS[self.signal]} outside"
        return f"{self.signal}: {how_far} at {self.time:.2f} s"


def funnel(time: Array, values: Array, tolerance: float) -> Funnel:
    """The funnel about a signal.

    Args:
        time, values: Shape (n,).
        tolerance: Half its height, in the signal's unit.
    """
    grid = np.arange(time[0], time[-1] + 1e-9, PERIOD)
    reference, size = np.interp(grid, time, values), 2 * round(TIME_TOLERANCE / PERIOD) + 1
    low = minimum_filter1d(reference, size, mode="nearest") - tolerance
    high = maximum_filter1d(reference, size, mode="nearest") + tolerance
    return Funnel(grid, low, high)


def record(samples: Mapping[str, Array], scenario: str, file: Path) -> None:
    """Keep a run of a scenario as golden, every PERIOD; what was golden before is gone.

    Raises:
        InputError: The file cannot be written.
    """
    time = samples["time"]
    grid = np.arange(time[0], time[-1] + 1e-9, PERIOD)
    columns = {"time": grid} | {name: np.interp(grid, time, samples[name]) for name in TOLERANCES}
    with written_file(file, "FILE.csv"):
        rounded = {name: np.round(values, 6) for name, values in columns.items()}
        write_columns(file, rounded, SAMPLE_UNITS, _HEAD + scenario)


def read_golden(file: Path, scenario: str) -> dict[str, Array]:
    """Columns of a golden recording.

    Args:
        file: By `record`.
        scenario: Name of the one that it has to be of.

    Raises:
        InputError: No such file, no golden recording, or one of another scenario.
    """
    columns = read_columns(file)
    with file.open(encoding="utf-8") as stream:
        head = stream.readline().removeprefix("# ").rstrip("\n")
    if not head.startswith(_HEAD) or columns.keys() != {"time", *TOLERANCES} or not len(columns["time"]):
        raise InputError(str(file), "is no golden recording", "a CSV by `sidestep golden record`")
    require_times(columns["time"], str(file))
    if (golden := head.removeprefix(_HEAD)) != scenario:
        raise InputError(str(file), f"is of the scenario {golden!r}, the run of {scenario!r}", "one of the same")
    return columns


def check(samples: Mapping[str, Array], golden: Mapping[str, Array]) -> list[Departure]:
    """Every signal of a run against its funnel."""
    departures = []
    for name, tolerance in TOLERANCES.items():
        bounds = funnel(golden["time"], golden[name], tolerance)
        excess = bounds.excess(samples["time"], samples[name])
        worst = int(np.argmax(excess))
        departures.append(Departure(name, float(excess[worst]), float(bounds.time[worst])))
    return departures
