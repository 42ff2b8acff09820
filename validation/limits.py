"""What the `sidestep limits` commands share: the bound of a count of failures, and how results are shown and kept."""

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar, cast

from joblib import Parallel, delayed
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from scipy.stats import beta

from sidestep.validation.console import progress_bar
from sidestep.validation.files import complete, made, write_text
from sidestep.validation.summary import strict_json

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


def upper_bound(failures: int, runs: int) -> float:
    """95 % upper bound of the failure rate (Clopper and Pearson, one-sided): 0 of 300 gives 1 %."""
    return 1.0 if failures >= runs else float(beta.ppf(CONFIDENCE, failures + 1, runs - failures))


def counted(failures: int, runs: int) -> str:
    """`k of n, at most p %`."""
    return f"{failures} of {runs}, rate at most {100.0 * upper_bound(failures, runs):.2g} %" if runs else "no run"


def in_parallel(title: str, calls: Sequence[Callable[[], Result]], jobs: int) -> list[Result]:
    """Results of all calls in their order, with a progress bar.

    Args:
        title: Beside the bar.
        calls: Picklable, such as functools.partial.
        jobs: Processes, -1 for one per core.
    """
    work = Parallel(n_jobs=jobs, return_as="generator")(delayed(call)() for call in calls)
    results: list[Result] = []
    with progress_bar(title, len(calls)) as progress:
        for result in cast("Iterable[Result]", work):
            results.append(result)
            progress(len(results))
    return results


def write_outcome(out: Path, outcome: Outcome, command_line: str) -> None:
    """Write NAME.json and NAME.csv."""
    with made(out):
        rows = [asdict(row) for row in outcome.rows]
        whole = {"command_line": command_line, "passed": outcome.passed, **outcome.summary, "rows": rows}
        write_text(out / f"{outcome.name}.json", strict_json(whole))
        with complete(out / f"{outcome.name}.csv") as stream:
            writer = csv.writer(stream)
            writer.writerow(f.name for f in fields(outcome.rows[0]))
            writer.writerows(row.values() for row in rows)


def new_table(title: str, first: str, *numbers: str) -> Table:
    """An empty table in the look of all tables."""
    table = Table(
        title=title, title_justify="left", title_style="bold", header_style="", box=SIMPLE_HEAD, pad_edge=False
    )
    table.add_column(first, no_wrap=True)
    for number in numbers:
        table.add_column(escape(number), justify="right")
    return table


def show(*parts: Table | str) -> None:
    """Print tables and lines; wide enough where there is no terminal."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=130)
    for part in parts:
        console.print(part)
