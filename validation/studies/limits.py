"""What the `sidestep limits` commands share: the bound of a count of failures, and how results are shown and kept."""

import csv
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal, TextIO, TypeVar, cast

from joblib import Parallel, delayed
from scipy.stats import beta

from sidestep.plant_models.errors import InputError
from sidestep.validation.console import progress_bar
from sidestep.validation.files import complete, made, write_text, written_to
from sidestep.validation.judge.summary import strict_json

CONFIDENCE = 0.95

Result = TypeVar("Result")


@dataclass(frozen=True)
class Outcome:
    """What a command found.

    Attributes:
        name: Of the files.
        summary: Figures of the whole, for the JSON file.
        rows: Flat dataclasses, one line of the CSV file each; the first one's fields are its columns.
        passed: Whether all thresholds are met.
    """

    name: str
    summary: dict[str, Any]
    rows: Sequence[Any]
    passed: bool


def refuse_own(overrides: Sequence[str], own: Mapping[str, str]) -> None:
    """Refuse changes of what a study sets itself: they would make no difference.

    Args:
        overrides: `key=value`, as given to `--set`.
        own: What is allowed instead, by the keys that the study sets, those below them included.

    Raises:
        InputError: One of them is changed.
    """
    for key in (change.partition("=")[0].strip() for change in overrides):
        for name, instead in own.items():
            if re.split(r"[.\[]", key)[: name.count(".") + 1] == name.split("."):
                raise InputError(f"--set {key}", "makes no difference here: this study sets it", instead)


PLANT_OPTION = {"plant.kind": "--plant"}
"""What every study takes as an option."""


def upper_bound(failures: int, runs: int) -> float:
    """95 % upper bound of the failure rate (Clopper and Pearson, one-sided): 0 of 300 gives 1 %."""
    return 1.0 if failures >= runs else float(beta.ppf(CONFIDENCE, failures + 1, runs - failures))


def lower_bound(failures: int, runs: int) -> float:
    """95 % lower bound of the failure rate (Clopper and Pearson, one-sided)."""
    return 0.0 if failures == 0 else float(beta.ppf(1.0 - CONFIDENCE, failures, runs - failures + 1))


MOST_RUNS = 1_000_000
"""More of them are not proposed."""


def deciding_runs(failures: int, runs: int, allowed: float) -> int | None:
    """How many runs would tell whether the failure rate is above what is allowed, if the same share of them failed.

    Args:
        failures, runs: So far.
        allowed: Failure rate.

    Returns:
        None if it takes more than MOST_RUNS: the share is too near.
    """
    rate = failures / runs if runs else 0.0

    def decided(n: int) -> bool:
        return upper_bound(math.ceil(rate * n), n) <= allowed or lower_bound(math.floor(rate * n), n) > allowed

    high = max(runs, 1)
    while not decided(high):
        if high > MOST_RUNS:
            return None
        high *= 2
    low = high // 2
    while low + 1 < high:
        middle = (low + high) // 2
        low, high = (low, middle) if decided(middle) else (middle, high)
    return high


def counted(failures: int, runs: int) -> str:
    """`k of n, at most p %`."""
    return f"{failures} of {runs}, rate at most {100.0 * upper_bound(failures, runs):.2g} %" if runs else "no run"


def in_parallel(
    title: str, calls: Sequence[Callable[[], Result]], jobs: int, done: Callable[[Result], None] | None = None
) -> list[Result]:
    """Results of all calls in their order, with a progress bar.

    Args:
        title: Beside the bar.
        calls: Picklable, such as functools.partial.
        jobs: Processes, -1 for one per core.
        done: Called with every result as soon as it and those before it are there.
    """
    work = Parallel(n_jobs=jobs, return_as="generator")(delayed(call)() for call in calls)
    results: list[Result] = []
    with progress_bar(title, len(calls)) as progress:
        for result in cast("Iterable[Result]", work):
            results.append(result)
            if done:
                done(result)
            progress(len(results))
    return results


def kept_rows(out: Path, name: str) -> Callable[[Any], None]:
    """What adds a row to NAME.csv at once: hours of work outlive whatever ends them.

    The first row replaces what is there of an earlier run, NAME.json included.

    Args:
        out: Folder, which is there.
        name: Of the file.

    Returns:
        A function that takes a row, a flat dataclass whose fields are the columns; raises InputError where the file
        cannot be written.
    """
    mode: Literal["w", "a"] = "w"

    def add(row: Any) -> None:
        nonlocal mode
        with written_to(out):
            if mode == "w":
                (out / f"{name}.json").unlink(missing_ok=True)
            with (out / f"{name}.csv").open(mode, newline="", encoding="utf-8") as stream:
                if mode == "w":
                    _write_head(stream, row)
                _write_rows(stream, [row])
        mode = "a"

    return add


def write_outcome(out: Path, outcome: Outcome, command_line: str) -> None:
    """Write NAME.json and NAME.csv."""
    with made(out), written_to(out):
        rows = [asdict(row) for row in outcome.rows]
        whole = {"command_line": command_line, "passed": outcome.passed, **outcome.summary, "rows": rows}
        write_text(out / f"{outcome.name}.json", strict_json(whole))
        with complete(out / f"{outcome.name}.csv") as stream:
            _write_head(stream, outcome.rows[0])
            _write_rows(stream, outcome.rows)


def _write_head(stream: TextIO, row: Any) -> None:
    csv.writer(stream).writerow(f.name for f in fields(row))


def _write_rows(stream: TextIO, rows: Sequence[Any]) -> None:
    csv.writer(stream).writerows(asdict(row).values() for row in rows)
