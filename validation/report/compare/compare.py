"""Runs beside each other: read back from their folders, overlaid, each pair rated after ISO/TS 18571."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, cycle
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from sidestep.plant_models.documents import read_json
from sidestep.plant_models.errors import InputError
from sidestep.validation.console import row_name
from sidestep.validation.loop.recording import SAMPLE_UNITS, Array, Recording, read_columns, require_times
from sidestep.validation.report.compare.comparison import Line, compared_top_view
from sidestep.validation.report.compare.golden import PERIOD, TIME_TOLERANCE, TOLERANCES, funnel
from sidestep.validation.report.compare.rating import Rating, rate
from sidestep.validation.report.evidence import Evidence, Table
from sidestep.validation.report.explore.scene_data import scene_data
from sidestep.validation.report.style import BLUE, FAINT, GREEN, ORANGE, PURPLE, RED, SKY, panel, styled, timeline
from sidestep.validation.scenarios.scenario import Scenario, scenario_from_tables

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, RED, SKY)
_PANELS = {
    "l": ("Lateral offset", "m"),
    "yaw_rate": ("Yaw rate", "deg/s"),
    "lateral_acceleration": ("Lateral acceleration", "m/s²"),
    "steer_angle": ("Steering angle", "deg"),
}


@dataclass(frozen=True, eq=False)
class StoredRun:
    """What a run left in its folder.

    Attributes:
        name: For legends, unlike that of the other runs.
        scenario: What was driven.
        summary: As in summary.json.
        samples: Columns of recording.csv.
    """

    name: str
    scenario: Scenario
    summary: Mapping[str, Any]
    samples: Mapping[str, Array]


def read_runs(folders: Sequence[Path]) -> list[StoredRun]:
    """Read runs that `sidestep run` wrote; named by plant and preset, or by folder where these are the same.

    Raises:
        InputError: A folder without a run.
    """
    runs = [_read(folder) for folder in folders]
    if len({run.name for run in runs}) == len(runs):
        return runs
    return [StoredRun(str(f), r.scenario, r.summary, r.samples) for f, r in zip(folders, runs, strict=True)]


_KEYS = {"scenario": str, "plant": str, "preset": str, "verdict": str, "label": str, "tables": dict, "folder": str}


def _read(folder: Path) -> StoredRun:
    summary = _summary(folder / "summary.json")
    file = Path(summary["folder"]) / f"{summary['scenario']}.toml"
    scenario = scenario_from_tables(summary["tables"], str(folder / "summary.json"), file)
    samples = read_columns(folder / "recording.csv")
    if missing := [name for name in SAMPLE_UNITS if not len(samples.get(name, ()))]:
        raise InputError(str(folder / "recording.csv"), f"lacks {', '.join(missing)}", _A_RUN)
    require_times(samples["time"], str(folder / "recording.csv"))
    return StoredRun(row_name(summary), scenario, summary, samples)


def _summary(file: Path) -> dict[str, Any]:
    summary = read_json(file, _A_RUN)
    if not isinstance(summary, dict) or any(not isinstance(summary.get(key), kind) for key, kind in _KEYS.items()):
        raise InputError(str(file), "is not that of one run", _A_RUN)
    return summary


_A_RUN = "a folder that `sidestep run` wrote"


class Pair(NamedTuple):
    """One signal of two runs; no rating where it never changes in the first."""

    reference: str
    other: str
    signal: str
    rating: Rating | None

    @property
    def overall(self) -> float:
        """Of the rating; 1 without one."""
        return self.rating.overall if self.rating else 1.0

    def __str__(self) -> str:
        rating = f"{self.overall:.3f} ({self.rating.grade})" if self.rating else "never changes"
        return f"{rating}, {_PANELS[self.signal][0].lower()} of {self.reference} / {self.other}"


def pairs(runs: Sequence[StoredRun]) -> list[Pair]:
    """Every signal of every two runs, the earlier one as the reference, rated for as long as both lasted."""
    return [
        Pair(a.name, b.name, signal, _rated(a, b, signal)) for a, b in combinations(runs, 2) for signal in TOLERANCES
    ]


def _rated(reference: StoredRun, other: StoredRun, signal: str) -> Rating | None:
    end = min(run.samples["time"][-1] for run in (reference, other))
    time = np.arange(0.0, end + 1e-9, PERIOD)
    first, second = (np.interp(time, run.samples["time"], run.samples[signal]) for run in (reference, other))
    return rate(first, second) if np.ptp(first) > 0.0 else None


def evidence(runs: Sequence[StoredRun], rated: Sequence[Pair], least: float | None = None) -> list[Evidence]:
    """What each run was worth, paths, overlaid signals and ratings.

    Args:
        runs: What is compared.
        rated: Its `pairs`.
        least: Overall rating that all have to reach, if any.
    """
    lines = [
        Line(run.name, colour, Recording(run.samples, {})) for run, colour in zip(runs, cycle(_COLOURS), strict=False)
    ]
    heights = ", ".join(f"{size * _scale(name):.3g} {_PANELS[name][1]}" for name, size in TOLERANCES.items())
    shape = f"± {heights} and {TIME_TOLERANCE:g} s"
    passed = None if least is None else all(pair.overall >= least for pair in rated)
    return [
        Evidence("Verdicts of the runs", table=_verdicts(runs)),
        Evidence("Paths", figure=compared_top_view(runs[0].scenario, lines), scene=scene_data(runs[0].scenario, lines)),
        Evidence("Signals", f"Grey: the funnel about {runs[0].name}, {shape}.", overlays(lines)),
        Evidence("Ratings after ISO/TS 18571", _RATINGS, table=_table(rated, least), passed=passed),
    ]


def _scale(signal: str) -> float:
    """From the recording's unit to the panel's."""
    return float(np.degrees(1.0)) if _PANELS[signal][1].startswith("deg") else 1.0


def _verdicts(runs: Sequence[StoredRun]) -> Table:
    rows = tuple((run.name, run.summary["verdict"].upper(), run.summary["label"]) for run in runs)
    return Table(("run", "verdict", "label"), rows)


_RATINGS = (
    "The first run of a pair is the reference; time from 0 to where the shorter run ends. Corridor, phase, magnitude "
    "and slope score from 0 to 1; the overall rating is 0.4 corridor + 0.2 of each other. Above 0.94 excellent, above "
    "0.8 good, above 0.58 fair, else poor."
)


def _table(rated: Sequence[Pair], least: float | None) -> Table:
    rows = []
    for pair in rated:
        scores = ("–",) * 6
        if rating := pair.rating:
            values = (rating.corridor, rating.phase, rating.magnitude, rating.slope, rating.overall)
            scores = (*(f"{value:.3f}" for value in values), rating.grade)
        verdict = () if least is None else ("PASS" if pair.overall >= least else "FAIL",)
        rows.append((f"{pair.reference} / {pair.other}", _PANELS[pair.signal][0], *scores, *verdict))
    heads = ("runs", "signal", "corridor", "phase", "magnitude", "slope", "overall", "grade")
    return Table(heads if least is None else (*heads, f"≥ {least:g}"), tuple(rows))


def overlays(lines: Sequence[Line]) -> Figure:
    """Four signals over time, with the funnel about the first run."""
    with styled():
        figure = Figure(figsize=(11.0, 5.2))
        figure.subplots_adjust(0.055, 0.09, 0.995, 0.9, wspace=0.12, hspace=0.38)
        axes = list(figure.subplots(2, 2).flat)
        for place, (signal, (title, unit)) in zip(axes, _PANELS.items(), strict=True):
            timeline(panel(place, title, unit))
            scale = _scale(signal)
            first = lines[0].recording
            bounds = funnel(first["time"], first[signal], TOLERANCES[signal])
            place.fill_between(
                bounds.time, scale * bounds.low, scale * bounds.high, color=FAINT, alpha=0.6, linewidth=0.0
            )
            for name, colour, recording in lines:
                place.plot(recording["time"], scale * recording[signal], color=colour, label=name)
        for place in axes[2:]:
            place.set_xlabel("time  [s]")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="upper right", ncols=len(lines), fontsize=8.5)
    return figure
