"""`sidestep limits delay`: delay between command and effect, with and without compensation.

The car starts beside the reference of a straight road and goes back to it. Delays of one control period come from the
one-step-delay coupling, as most co-simulation masters have it, longer ones from a bus that takes its time. Compensated,
the controller knows (`input_delay_steps`) and moves the state forward through the commands on their way;
uncompensated, it takes the state as present.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from sidestep.validation.console import new_table, show
from sidestep.validation.files import made, written_to
from sidestep.validation.loop.closed_loop import closed_loop
from sidestep.validation.loop.delay_line import DelayLine
from sidestep.validation.loop.recording import End, Recording
from sidestep.validation.report.style import BLUE, RED, panel, styled, write_figure
from sidestep.validation.scenarios.scenario import Scenario, parse_scenario
from sidestep.validation.studies.limits import PLANT_OPTION, Outcome, refuse_own, write_outcome

CASES = ((0.1, 1), (0.05, 1), (0.02, 5), (0.02, 10))
"""Control period, in [s], and delay in periods."""
SETTLED, LAST = 0.01, 2.0
"""Offset (RMS) below which the car has settled, in [m], and the time at the end in which it is taken, in [s]."""

_SCENE = """
name = "delay"
speed = 15.0
duration = 8.0
road = { width_left = 6.0, width_right = 6.0, segments = [{ type = "line", length = 300.0 }] }
start = { l = 1.5 }
"""


@dataclass(frozen=True)
class DelayRow:
    """One run.

    Attributes:
        period, delay: Control period, and from a command to its effect, in [s].
        compensated: Whether the controller knew of the delay.
        max_offset: Largest offset after the first second, in [m].
        final_offset: RMS over the last seconds, in [m].
        max_steer_rate: In [rad/s].
        end: Why the run ended.
    """

    period: float
    delay: float
    compensated: bool
    max_offset: float
    final_offset: float
    max_steer_rate: float
    end: str

    @property
    def settled(self) -> bool:
        """Whether the car is back on the reference."""
        return self.end == End.COMPLETED.value and self.final_offset <= SETTLED


def delay(plant: str, overrides: Sequence[str], out: Path, command_line: str) -> int:
    """Drive both controllers with every delay; print a table, write figures and plot.

    Args:
        plant: As in a scenario file.
        overrides: `key=value`, as given to `--set`.
        out: Folder for delay.json, delay.csv and delay.png.
        command_line: For the JSON file.

    Returns:
        Exit status: 0 if the compensated controller always settles.

    Raises:
        InputError: Bad override or plant, or a folder that takes no files.
    """
    refuse_own(
        overrides, PLANT_OPTION | {"controller.period": "its CASES", "controller.input_delay_steps": "its CASES"}
    )
    cases = [(period, steps, known) for period, steps in CASES for known in (True, False)]
    with made(out):
        scenes = {case: scene(*case, plant, overrides) for case in cases}
        runs = {case: drive(scenario, case[1]) for case, scenario in scenes.items()}
        rows = [_row(*case, recording) for case, recording in runs.items()]
        with written_to(out):
            write_figure(out / "delay.png", figure(runs))
    passed = all(row.settled for row in rows if row.compensated)
    write_outcome(out, Outcome("delay", {"plant": plant, "settled_m": SETTLED}, rows, passed), command_line)
    show(_table(rows, plant, scenes[cases[0]].speed))
    return 0 if passed else 1


def scene(period: float, steps: int, compensated: bool, plant: str, overrides: Sequence[str] = ()) -> Scenario:
    """The scene at a control period [s], with a controller that knows of `steps` periods of delay or does not.

    Raises:
        InputError: Bad override.
    """
    known = steps if compensated else 0
    own = [f"controller.period={period}", f"controller.input_delay_steps={known}", f"plant.kind={plant}"]
    return parse_scenario(_SCENE, "delay", [*overrides, *own])


def drive(scenario: Scenario, steps: int) -> Recording:
    """The run with a delay of `steps` control periods: the first by the coupling, the others on the bus."""
    bus = DelayLine((steps - 1) * scenario.controller.period)
    return closed_loop(scenario, port=bus, coupling="one-step-delay")


def figure(runs: dict[tuple[float, int, bool], Recording]) -> Figure:
    """Offset and steering angle over time, one column for every delay."""
    with styled():
        figure = Figure(figsize=(11.0, 4.2))
        figure.subplots_adjust(0.045, 0.11, 0.995, 0.87, wspace=0.2, hspace=0.4)
        axes = figure.subplots(2, len(CASES))
        for column, (period, steps) in enumerate(CASES):
            offset, steering = axes[:, column]
            panel(offset, f"Offset, {_name(period, steps)}", "m")
            panel(steering, "Steering angle", "deg").set_xlabel("time  [s]")
            for known, colour, name in ((False, RED, "not compensated"), (True, BLUE, "compensated")):
                recording = runs[period, steps, known]
                offset.plot(recording["time"], recording["l"], color=colour, label=name)
                steering.plot(recording["time"], np.degrees(recording["steer_angle"]), color=colour)
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="upper right", ncols=2)
    return figure


def _name(period: float, steps: int) -> str:
    return f"{steps} x {1e3 * period:.0f} ms" if steps > 1 else f"one step of {1e3 * period:.0f} ms"


def _row(period: float, steps: int, compensated: bool, recording: Recording) -> DelayRow:
    time, offset = recording["time"], np.abs(recording["l"])
    last = offset[time >= time[-1] - LAST]
    return DelayRow(
        period, steps * period, compensated, float(offset[time >= 1.0].max()), float(np.sqrt(np.mean(last**2))),
        float(np.abs(recording["steer_rate"]).max()), recording.end.value,
    )  # fmt: skip


def _table(rows: Sequence[DelayRow], plant: str, speed: float) -> Table:
    table = new_table(
        f"Delay, 1.5 m off at {speed:g} m/s on {plant}", "delay", "control\nperiod", "largest offset\nafter 1 s [m]",
        f"RMS offset in the\nlast {LAST:.0f} s [m]", "max steer\nrate [deg/s]", "end",
    )  # fmt: skip
    for row in rows:
        table.add_row(
            f"{row.delay:.2f} s, {'compensated' if row.compensated else 'not compensated'}",
            f"{1e3 * row.period:.0f} ms", f"{row.max_offset:.3f}",
            f"[{'green' if row.settled else 'red'}]{row.final_offset:.4f}[/]",
            f"{math.degrees(row.max_steer_rate):.1f}", row.end,
        )  # fmt: skip
    return table
