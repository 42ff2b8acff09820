"""What the commands show: progress, and the table of runs that the demo's report has, too."""

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from sidestep.validation.interrupt import interrupts_between_steps

HEADS = (
    "clearance\n[m]", "max |a_y|\n[m/s²]", "max steer\nrate [deg/s]", "lateral error\nRMS [m]", "infeasible\nsteps",
    "step [µs]\nmedian / p99", "CAN\nframes",
)  # fmt: skip
"""Columns after plant and verdict."""


def warn(sentences: Sequence[str]) -> None:
    """Lines on stderr that do not change the exit status."""
    for sentence in sentences:
        print(f"sidestep: warning: {' '.join(sentence.split())}", file=sys.stderr)


def number(value: float | None, unit: str, digits: int) -> str:
    """A value with its unit, or a dash where there is none."""
    if value is None:
        return "–"
    return f"{value:.{digits}f} {unit}".rstrip() if abs(value) < 1e5 else f"{value:.3g} {unit}".rstrip()


def cells(summary: dict[str, Any]) -> list[str]:
    """What stands under HEADS; dashes for a run that could not be started."""
    if "step_time_us" not in summary:
        return ["–"] * len(HEADS)
    times = summary["step_time_us"]
    return [
        number(summary["min_clearance_m"], "", 3),
        number(summary["max_lateral_acceleration"], "", 2),
        number(math.degrees(summary["max_steer_rate"]), "", 1),
        number(summary["rms_lateral_error_m"], "", 3),
        str(summary["infeasible_steps"]),
        f"{number(times['median'], '', 0)} / {number(times['p99'], '', 0)}",
        str(summary["can"]["sent"]),
    ]


def new_table(title: str, first: str, *numbers: str) -> Table:
    """An empty table in the look of all tables; title and heads are words, not markup."""
    table = Table(
        title=escape(title), title_justify="left", title_style="bold", header_style="", box=SIMPLE_HEAD, pad_edge=False
    )
    table.add_column(escape(first), no_wrap=True)
    for head in numbers:
        table.add_column(escape(head), justify="right")
    return table


def show(*parts: Table | str) -> None:
    """Print tables and lines; a terminal too narrow for a table gets a list: a figure a line."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=130)
    unbounded = console.options.update(max_width=10_000)
    for part in parts:
        if isinstance(part, Table) and console.measure(part, options=unbounded).maximum > console.width:
            _print_list(console, part)
        else:
            console.print(part)


def _print_list(console: Console, table: Table) -> None:
    """The rows of a table one below the other: its first cell, then head and value of every other one."""
    console.print()
    if table.title:
        console.print(table.title, style="bold")
    heads = [str(column.header).replace("\n", " ").strip() for column in table.columns]
    for first, *cells in zip(*(column.cells for column in table.columns), strict=True):
        console.print(first, style="underline")
        for head, cell in zip(heads[1:], cells, strict=True):
            if str(cell).strip():
                console.print(f"  {head}: {cell}" if head else f"  {cell}")


def print_runs(summaries: Sequence[dict[str, Any]]) -> None:
    """Print a table for every scenario, and the reason of every verdict that has more to it than its label."""
    for scenario in dict.fromkeys(s["scenario"] for s in summaries):
        show(_table(scenario, [s for s in summaries if s["scenario"] == scenario]))
    for s in summaries:
        for words in (s["error"], s["detail"], *(f"{f['label']}: {f['text']}" for f in s.get("findings", ()))):
            if words:
                show(escape(f"{s['scenario']} on {s['plant']}: {words}"))


def row_name(summary: dict[str, Any]) -> str:
    """The plant, and the preset unless it is the default; for somebody else's controller its name."""
    own = summary.get("controller", "sidestep").rpartition(":")[2]
    of = own if own != "sidestep" else summary["preset"]
    return summary["plant"] + (f" ({of})" if of != "default" else "")


def _table(title: str, summaries: Sequence[dict[str, Any]]) -> Table:
    table = new_table(title, "plant", "verdict", *HEADS)
    table.columns[1].justify, table.columns[1].no_wrap = "left", True
    for s in summaries:
        table.add_row(escape(row_name(s)), coloured(s["verdict"], f"{s['verdict']}: {s['label']}"), *cells(s))
    return table


def coloured(verdict: str, text: str) -> str:
    """Text in the colour of a verdict, for tables."""
    colours = {"pass": "green", "fail": "red", "inconclusive": "yellow"}
    return f"[{colours[verdict]}]{escape(text)}[/]"


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.1f}/s" if task.speed else "-/s")


@contextmanager
def progress_bar(title: str, total: float, counting: bool = False) -> Iterator[Callable[[float], None]]:
    """A bar on the terminal's stderr, nothing elsewhere.

    Args:
        title: Beside it.
        total: What is the whole.
        counting: Whether it is so many runs: show how many are done, how many a second, and for how long yet.

    Yields what sets how far it is, and raises the KeyboardInterrupt that came since; until then Ctrl-C waits.
    """
    columns: tuple[ProgressColumn, ...] = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    if counting:
        columns += (MofNCompleteColumn(), _Rate(), TextColumn("left:"), TimeRemainingColumn())
    console = Console(stderr=True)
    with (
        interrupts_between_steps() as interruption,
        Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar,
    ):
        task = bar.add_task(title, total=total)

        def progress(done: float) -> None:
            bar.update(task, completed=done)
            interruption()

        yield progress
