"""`sidestep limits optimum`: peaks of the controller's drives against those of the offline optimum of the same scenes.

The optimum is made by benchmarks/studies/offline_optimum.py. Jerk is the derivative of a_y after a low-pass, the
same one for drive and optimum: Butterworth of second order, forwards and backwards, at JERK_BANDWIDTH.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scipy.signal import butter, sosfiltfilt

from sidestep.validation.console import new_table, show
from sidestep.validation.loop.closed_loop import closed_loop
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.limits import PLANT_OPTION, Outcome, refuse_own, write_outcome

Array = NDArray[np.float64]

SCENES = ("single-obstacle", "double-obstacle")
RESULTS = Path(__file__).parents[1] / "scenarios" / "built_in" / "offline_optimum.json"
JERK_BANDWIDTH = 5.0
"""Of the low-pass before a_y is differentiated, in [Hz]."""
MAX_ACCELERATION, MAX_JERK = 1.15, 1.5
"""Allowed ratios of the peaks to those of the optimum."""
MAX_STEER_RATE = {"single-obstacle": 0.25}
"""Allowed in the scene, in [rad/s]; the double obstacle needs more by physics."""


@dataclass(frozen=True)
class Peaks:
    """Largest magnitudes of a drive.

    Attributes:
        lateral_acceleration: In [m/s^2].
        jerk: Of the low-passed a_y, in [m/s^3].
        steer_rate: In [rad/s].
    """

    lateral_acceleration: float
    jerk: float
    steer_rate: float

    @classmethod
    def of(cls, time: Array, lateral_acceleration: Array, steer_rate: Array) -> Self:
        """Peaks of signals that are sampled evenly, shape (n,)."""
        smooth = low_passed(time, lateral_acceleration)
        return cls(_peak(lateral_acceleration), _peak(np.gradient(smooth, time)), _peak(steer_rate))

    @classmethod
    def of_recording(cls, recording: Recording) -> Self:
        """Peaks of a drive."""
        return cls.of(recording["time"], recording["lateral_acceleration"], recording["steer_rate"])


@dataclass(frozen=True)
class OptimumRow:
    """A drive and the optimum.

    Attributes:
        scene, plant: What was driven.
        lateral_acceleration, jerk, steer_rate: Its peaks, see Peaks.
        acceleration_ratio, jerk_ratio, steer_rate_ratio: To the optimum's.
    """

    scene: str
    plant: str
    lateral_acceleration: float
    jerk: float
    steer_rate: float
    acceleration_ratio: float
    jerk_ratio: float
    steer_rate_ratio: float

    @property
    def passed(self) -> bool:
        """Whether all thresholds are met."""
        return (
            self.acceleration_ratio <= MAX_ACCELERATION
            and self.jerk_ratio <= MAX_JERK
            and self.steer_rate <= MAX_STEER_RATE.get(self.scene, np.inf)
        )


def optimum(plants: Sequence[str], overrides: Sequence[str], out: Path, command_line: str) -> int:
    """Drive both scenes on every plant and compare.

    Args:
        plants: As in a scenario file.
        overrides: `key=value`, as given to `--set`.
        out: Folder for optimum.json and optimum.csv.
        command_line: For the JSON file.

    Returns:
        Exit status: 0 if all peaks are within the allowed ratios.

    Raises:
        InputError: Bad override or plant, or a folder that takes no files.
    """
    refuse_own(overrides, PLANT_OPTION)
    rows = [_drive(scene, plant, overrides) for scene in SCENES for plant in plants]
    passed = all(row.passed for row in rows)
    write_outcome(out, Outcome("optimum", {"optimum": offline_optimum()}, rows, passed), command_line)
    show(_table(rows))
    return 0 if passed else 1


def offline_optimum() -> dict[str, dict[str, float]]:
    """What benchmarks/studies/offline_optimum.py found, by scene: the fields of Peaks, sides and nodes."""
    return json.loads(RESULTS.read_text(encoding="utf-8"))


def compare(scene: str, plant: str, peaks: Peaks) -> OptimumRow:
    """Peaks of a drive in one of SCENES against the optimum's."""
    best = offline_optimum()[scene]
    return OptimumRow(
        scene, plant, peaks.lateral_acceleration, peaks.jerk, peaks.steer_rate,
        peaks.lateral_acceleration / best["lateral_acceleration"], peaks.jerk / best["jerk"],
        peaks.steer_rate / best["steer_rate"],
    )  # fmt: skip


def low_passed(time: Array, signal: Array) -> Array:
    """The signal without what is faster than JERK_BANDWIDTH, without delay; constant before and after its time."""
    rate = (len(time) - 1) / (time[-1] - time[0])
    beyond = min(round(rate), len(time) - 1)
    return sosfiltfilt(butter(2, JERK_BANDWIDTH, fs=rate, output="sos"), signal, padtype="constant", padlen=beyond)


def _drive(scene: str, plant: str, overrides: Sequence[str]) -> OptimumRow:
    scenario = load_scenario(scene, [*overrides, f"plant.kind={plant}"])
    return compare(scene, plant, Peaks.of_recording(closed_loop(scenario)))


def _peak(values: Array) -> float:
    return float(np.abs(values).max())


def _table(rows: Sequence[OptimumRow]) -> Table:
    table = new_table(
        "Peaks, and their ratio to the offline optimum's", "scene", "plant", "|a_y|\n[m/s²]",
        f"ratio\n<= {MAX_ACCELERATION}", "|jerk|\n[m/s³]", f"ratio\n<= {MAX_JERK}", "steer rate\n[deg/s]", "ratio", "",
    )  # fmt: skip
    for row in rows:
        table.add_row(
            row.scene, row.plant, f"{row.lateral_acceleration:.2f}", f"{row.acceleration_ratio:.2f}",
            f"{row.jerk:.1f}", f"{row.jerk_ratio:.2f}", f"{math.degrees(row.steer_rate):.2f}",
            f"{row.steer_rate_ratio:.2f}", "[green]pass[/]" if row.passed else "[red]fail[/]",
        )  # fmt: skip
    return table
