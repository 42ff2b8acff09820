"""What the commands show: progress, and the table of runs that the demo's report has, too."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

HEADS = (
    "clearance [m]", "max |a_y| [m/s²]", "max steer rate [rad/s]", "lateral error RMS [m]",
    "infeasible steps", "step median/p99 [µs]", "CAN frames",
)  # fmt: skip
"""Columns after plant and verdict."""


def number(value: float | None, unit: str, digits: int) -> str:
    """A value with its unit, or a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}f} {unit}".rstrip()


def cells(summary: dict[str, Any]) -> list[str]:
    """What stands under HEADS; dashes for a run that could not be started."""
    if "step_time_us" not in summary:
        return ["–"] * len(HEADS)
    times = summary["step_time_us"]
    return [
        number(summary["min_clearance_m"], "", 3),
        number(summary["max_lateral_acceleration"], "", 2),
        number(summary["max_steer_rate"], "", 3),
        number(summary["rms_lateral_error_m"], "", 3),
        str(summary["infeasible_steps"]),
        f"{number(times['median'], '', 0)} / {number(times['p99'], '', 0)}",
        str(summary["can"]["sent"]),
    ]


def print_runs(summaries: Sequence[dict[str, Any]]) -> None:
    """Print the table, and the reason of every run that could not go on."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)
    console.print(run_table(summaries))
    for s in summaries:
        if s["error"]:
            console.print(f"{s['scenario']} on {s['plant']}: {s['error']}", markup=False)


def run_table(summaries: Sequence[dict[str, Any]]) -> Table:
    """A row for every run; the scenario is named where there are several."""
    table = Table(header_style="bold")
    table.add_column("scenario")
    table.add_column("plant")
    table.add_column("verdict")
    for head in HEADS:
        table.add_column(escape(head), justify="right")
    for s in summaries:
        colour = "green" if s["verdict"] == "pass" else "red"
        plant = s["plant"] + (f" ({s['preset']})" if s["preset"] != "default" else "")
        table.add_row(s["scenario"], plant, f"[{colour}]{s['verdict']}[/]: {s['label']}", *cells(s))
    return table


@contextmanager
def progress_bar(title: str, total: float) -> Iterator[Callable[[float], None]]:
    """A bar on the terminal's stderr, nothing elsewhere; yields what sets how far it is."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)
