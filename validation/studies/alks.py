"""`sidestep limits alks`: OpenSCENARIO files and their variations, driven, and beside them drivers who only brake."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from rich.table import Table

from sidestep.plant_models.errors import InputError
from sidestep.validation.console import new_table, show
from sidestep.validation.files import complete_path, made, written_to
from sidestep.validation.judge.careful_driver import DRIVERS, smallest_gap
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.judge.verdict import Judgement
from sidestep.validation.report.style import BLUE, GREEN, ORANGE, RED, styled
from sidestep.validation.scenarios.readers.openscenario.reader import variations
from sidestep.validation.scenarios.readers.safe_xml import read_xml
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.limits import Outcome, in_parallel, kept_rows, write_outcome

LONGEST = 60.0
"""Of a drive, in [s]: what a scenario asks beyond is more of the same."""


@dataclass(frozen=True)
class AlksRow:
    """One scenario.

    Attributes:
        file: Its name without ending.
        parameters: Those of a variation.
        speed: At the start, in [m/s].
        label: Of our drive, see Judgement.
        clearance: Of our drive, in [m].
        careful, performance, rss: Closest approach of those drivers, in [m]; 0 if they collide.
        error: Why it was refused.
    """

    file: str
    parameters: str
    speed: float
    label: str
    clearance: float
    careful: float
    performance: float
    rss: float
    error: str = ""

    @property
    def collides(self) -> bool:
        """Whether we do."""
        return self.clearance <= 0.0

    @property
    def worse(self) -> bool:
        """Whether we collide where the careful driver does not, or the file was refused."""
        return bool(self.error) or (self.collides and self.careful > 0.0)


def alks(
    files: Sequence[Path], plant: str, overrides: Sequence[str], count: int, jobs: int, out: Path, command_line: str
) -> int:
    """Drive OpenSCENARIO files; of files of variations, `count` spread evenly over them.

    Args:
        files: Or folders of them.
        plant: As in a scenario file.
        overrides: `key=value`, as given to `--set`.
        count: Variations of each at most.
        jobs: Processes, -1 for one per core.
        out: Folder for alks.json, alks.csv and alks.png.
        command_line: For the JSON file.

    Returns:
        Exit status: 0 if we collide nowhere where the careful driver does not.

    Raises:
        InputError: No file, or a folder that takes no files.
    """
    cases = [case for file in _found(files) for case in _cases(file, count)]
    if not cases:
        raise InputError("FILE", "no .xosc file", "OpenSCENARIO files, or folders of them")
    calls = [partial(run_case, file, parameters, plant, tuple(overrides)) for file, parameters in cases]
    with made(out):
        rows = in_parallel(f"OpenSCENARIO on {plant}", calls, jobs, kept_rows(out, "alks"))
    failed = [row for row in rows if row.worse]
    with written_to(out), complete_path(out / "alks.png") as picture:
        _map(rows).savefig(picture, format="png", dpi=110)
    write_outcome(out, Outcome("alks", _summary(rows), rows, not failed), command_line)
    show(_table(rows, plant), *(f"{row.file} {row.parameters}: {row.error or row.label}" for row in failed))
    return 1 if failed else 0


def run_case(file: Path, parameters: dict[str, str], plant: str, overrides: Sequence[str] = ()) -> AlksRow:
    """Read, drive and judge one scenario, and let the drivers drive it: a pure function."""
    words = " ".join(f"{key}={value}" for key, value in parameters.items())
    own = [f"parameters.{key}={value}" for key, value in parameters.items()]
    try:
        scenario = load_scenario(file, [*own, f"plant.kind={plant}", *overrides])
        if scenario.duration > LONGEST:
            scenario = load_scenario(file, [*own, f"plant.kind={plant}", f"duration={LONGEST}", *overrides])
        judgement: Judgement = simulate(scenario)[1]
    except InputError as error:
        return AlksRow(file.stem, words, np.nan, "refused", np.nan, np.nan, np.nan, np.nan, str(error))
    gaps = {name: smallest_gap(scenario, driver) for name, driver in DRIVERS.items()}
    clearance = np.inf if judgement.min_clearance is None else judgement.min_clearance
    return AlksRow(
        file.stem,
        words,
        scenario.start.v_x,
        judgement.label,
        clearance,
        gaps["careful"],
        gaps["performance"],
        gaps["RSS"],
    )


def _found(files: Sequence[Path]) -> list[Path]:
    found = [inner for file in files for inner in (sorted(file.glob("*.xosc")) if file.is_dir() else [file])]
    for file in found:
        if not file.is_file():
            raise InputError(str(file), "no such file")
    return found


def _cases(file: Path, count: int) -> list[tuple[Path, dict[str, str]]]:
    root = read_xml(file)
    if root.find("ParameterValueDistribution") is None:
        return [(file, {})] if root.find("Storyboard") is not None else []
    _, values = variations(root, file)
    # Steps by the golden ratio: every stretch of the list, and so every value of each axis, gets its share.
    chosen = sorted({int(len(values) * ((0.5 + k * 0.6180339887) % 1.0)) for k in range(min(count, len(values)))})
    return [(file, values[i]) for i in chosen]


def _summary(rows: Sequence[AlksRow]) -> dict[str, object]:
    return {
        "drives": len(rows),
        "refused": sum(bool(row.error) for row in rows),
        "we_collide": sum(row.collides for row in rows),
        "careful_driver_collides": sum(row.careful == 0.0 for row in rows),
        "only_we_collide": sum(row.collides and row.careful > 0.0 for row in rows),
        "only_the_careful_driver_collides": sum(row.careful == 0.0 and not row.collides for row in rows),
    }


def _table(rows: Sequence[AlksRow], plant: str) -> Table:
    table = new_table(
        f"{len(rows)} OpenSCENARIO drives on {plant}: collisions of ours and of drivers who only brake",
        "file", "drives", "refused", "we", "least [m]", "careful", "5.2.5.2", "RSS", "only we",
    )  # fmt: skip
    for name in dict.fromkeys(row.file for row in rows):
        of = [row for row in rows if row.file == name]
        gaps = [row.clearance for row in of if np.isfinite(row.clearance)]
        table.add_row(
            name.removeprefix("alks_scenario_").removesuffix("_template"), str(len(of)),
            str(sum(bool(row.error) for row in of)), str(sum(row.collides for row in of)),
            f"{min(gaps):.2f}" if gaps else "–", *(str(sum(getattr(row, k) == 0.0 for row in of)) for k in _GAPS),
            str(sum(row.worse and not row.error for row in of)),
        )  # fmt: skip
    return table


_GAPS = ("careful", "performance", "rss")


def _map(rows: Sequence[AlksRow]):
    """Our clearance over the careful driver's: where only one of both collides."""
    from matplotlib.figure import Figure

    with styled():
        figure = Figure(figsize=(7.0, 5.0))
        axes = figure.subplots()
        done = [row for row in rows if not row.error and np.isfinite(row.clearance)]
        for ours, theirs, colour, label in (
            (False, False, GREEN, "neither collides"), (False, True, BLUE, "only the careful driver"),
            (True, False, RED, "only we"), (True, True, ORANGE, "both"),
        ):  # fmt: skip
            of = [row for row in done if row.collides == ours and (row.careful == 0.0) == theirs]
            axes.scatter(
                [row.careful for row in of],
                [row.clearance for row in of],
                color=colour,
                s=14,
                label=f"{label}: {len(of)}",
            )
        axes.set(
            xscale="symlog",
            yscale="symlog",
            xlabel="careful driver's closest approach  [m]",
            ylabel="our clearance  [m]",
        )
        axes.axhline(0.0, color="black", linewidth=0.6)
        axes.legend(loc="lower right")
    return figure
