"""`sidestep limits endurance`: a day of simulated driving at 100 Hz on a closed road: what grows, is late, or is NaN.

The day is cut into stints of half a minute. Each begins where the last one ended, with new obstacles ahead: boxes to
pass, slow cars to overtake, or a wall to stop before, which is gone in the next stint. One plant serves all of them.

A step is late when it takes more processor time than its period: what the scheduler gives to others in between is not
the controller's, and in virtual time nobody waits. A virtual machine that is held by its host counts that as processor
time, too. So a stint with a long step is driven again from its start, to the last bit the same: what is long in both is
the controller's, what is long in one is the machine's, or code that is loaded at its first use.
"""

import gc
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.console import new_table, number, progress_bar, show
from sidestep.validation.files import made
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import closed_loop, open_controller
from sidestep.validation.loop.cosimulation import Controller
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import Recording
from sidestep.validation.loop.wrapped import Wrapped
from sidestep.validation.scenarios.scenario import Scenario, parse_scenario
from sidestep.validation.studies.limits import PLANT_OPTION, Outcome, counted, kept_rows, refuse_own, write_outcome

PERIOD = 0.01
"""Control period, in [s]."""
STINT = 30.0
"""Simulated time of a stint, in [s]."""
MAX_GROWTH = 5.0
"""Of the resident memory, in [MiB]."""
WARM_UP = 20
"""Stints after which memory is first looked at; half of all if there are fewer."""

_LONG = 1e6 * PERIOD  # a step, in [us]
_RADIUS, _TURN_IN, _STRAIGHT = 120.0, 60.0, 300.0  # of the road, in [m]
_ARC = math.pi * _RADIUS - _TURN_IN  # with the two clothoids, half a turn
_SCENE = f"""
name = "endurance"
speed = 16.0
duration = {STINT}
controller = {{ period = {PERIOD} }}
[road]
width_left = 4.0
width_right = 4.0
segments = [
    {{ type = "line", length = {_STRAIGHT} }},
    {{ type = "clothoid", length = {_TURN_IN}, curvature_start = 0.0, curvature_end = {1.0 / _RADIUS} }},
    {{ type = "arc", length = {_ARC}, curvature = {1.0 / _RADIUS} }},
    {{ type = "clothoid", length = {_TURN_IN}, curvature_start = {1.0 / _RADIUS}, curvature_end = 0.0 }},
    {{ type = "line", length = {_STRAIGHT} }},
    {{ type = "clothoid", length = {_TURN_IN}, curvature_start = 0.0, curvature_end = {1.0 / _RADIUS} }},
    {{ type = "arc", length = {_ARC}, curvature = {1.0 / _RADIUS} }},
    {{ type = "clothoid", length = {_TURN_IN}, curvature_start = {1.0 / _RADIUS}, curvature_end = 0.0 }},
]
"""


@dataclass(frozen=True)
class StintRow:
    """One stint.

    Attributes:
        stint: Number, which is also the seed of its obstacles, less the first seed.
        verdict, label, end: See Judgement and Recording.
        touched: Whether something was hit, the road left, or the run broke off.
        min_clearance: In [m].
        distance: Driven, in [m].
        steps, late, stalled: Controller steps; those that took longer than PERIOD twice; those that did so once.
        not_finite: Numbers that are not finite.
        longest_step, longest_stall: Of those that are not stalled, and of those that are; processor time in [us].
        memory: Resident at its end, in [MiB]; NaN where the system does not tell.
    """

    stint: int
    verdict: str
    label: str
    end: str
    touched: bool
    min_clearance: float
    distance: float
    steps: int
    late: int
    stalled: int
    not_finite: int
    longest_step: float
    longest_stall: float
    memory: float

    @property
    def held_back(self) -> bool:
        """Whether the car stopped, crept or was not driven as asked, where there was a way past."""
        return self.verdict == Verdict.FAIL.value and not self.touched


def endurance(
    hours: float, seed: int, plant: str, overrides: Sequence[str], out: Path, command_line: str
) -> int:  # fmt: skip
    """Drive for `hours`, print a table, write one row a stint.

    Args:
        hours: Simulated time, in [h].
        seed: Of the first stint.
        plant: As in a scenario file.
        overrides: `key=value`, as given to `--set`.
        out: Folder for endurance.json and endurance.csv, which has every stint as soon as it is driven.
        command_line: For the JSON file.

    Returns:
        Exit status: 0 without a collision, a stop or a creeping drive where there was a way past, a late step, a number
            that is not finite, or memory that grows.

    Raises:
        InputError: Bad override or plant, or a folder that takes no files.
    """
    refuse_own(overrides, PLANT_OPTION | {"obstacles": "--seed-from"})
    scenario = parse_scenario(_SCENE, "endurance", [*overrides, f"plant.kind={plant}"])
    rows: list[StintRow] = []
    count = max(1, round(3600.0 * hours / STINT))
    keep = kept_rows(out, "endurance")
    with made(out), progress_bar(f"{hours:g} h on {plant}", count) as progress, open_plant(scenario) as car:
        state = scenario.start
        _drive(scenario, car, state, 0, seed)  # load the kernels before anything is timed
        for stint in range(count):
            row, state = _drive(scenario, car, state, stint, seed)
            keep(row)
            rows.append(row)
            progress(len(rows))
    growth = memory_growth(rows)
    touched, held_back = sum(row.touched for row in rows), sum(row.held_back for row in rows)
    longest_stall = max(row.longest_stall for row in rows)
    late, not_finite = sum(row.late for row in rows), sum(row.not_finite for row in rows)
    passed = not (touched or held_back or late or not_finite or growth > MAX_GROWTH)
    summary = {
        "hours": count * STINT / 3600.0, "plant": plant, "touched": touched, "held_back": held_back,
        "inconclusive": sum(row.verdict == Verdict.INCONCLUSIVE.value for row in rows), "late_steps": late,
        "stalled_steps": sum(row.stalled for row in rows), "not_finite": not_finite, "memory_growth_mib": growth,
    }  # fmt: skip
    write_outcome(out, Outcome("endurance", summary, rows, passed), command_line)
    table = new_table(f"{count * STINT / 3600.0:.2f} h on {plant}", "", "")
    for name, value in (
        ("driven", f"{sum(row.distance for row in rows) / 1000.0:.1f} km"),
        ("stints that touched something", counted(touched, count)),
        ("stopped or slow though there was a way past", counted(held_back, count)),
        ("stints that show nothing", str(summary["inconclusive"])),
        ("steps over 10 ms of processor time", f"{late} of {sum(row.steps for row in rows)}"),
        ("longest step", f"{max(row.longest_step for row in rows) / 1000.0:.2f} ms"),
        ("steps held up by the machine", f"{summary['stalled_steps']}"),
        ("longest of them", number(longest_stall / 1000.0 or None, "ms", 2)),
        ("numbers not finite", str(not_finite)),
        ("memory", f"{rows[-1].memory:.1f} MiB, grown by {growth:+.1f}"),
    ):
        table.add_row(name, value)
    show(table)
    return 0 if passed else 1


def obstacles_ahead(scenario: Scenario, s: float, seed: int) -> tuple[Obstacle, ...]:
    """Obstacles of one stint, from station `s` on: there is always a way past them, or a stop before them."""
    random = np.random.default_rng(seed)
    speed, right, left = scenario.speed, -scenario.controller.width_right, scenario.controller.width_left
    first = s + 60.0
    kind = random.random()
    if kind < 0.15:
        return (Obstacle(first + random.uniform(50.0, 150.0), (right + left) / 2.0, 1.0, left - right),)
    if kind < 0.4:
        slow = random.uniform(0.2, 0.5, 2) * speed
        return tuple(Obstacle(first + 90.0 * i, random.uniform(right + 1.0, -1.0), 4.5, 1.8, 0.0, v)
                     for i, v in enumerate(np.sort(slow)))  # fmt: skip
    stations = np.arange(first, first + 0.8 * STINT * speed, 4.0 * speed)
    return tuple(
        Obstacle(
            station + random.uniform(-8.0, 8.0), random.uniform(right, left), random.uniform(0.5, 5.0),
            random.uniform(0.5, 2.0), random.uniform(-0.2, 0.2),
        )
        for station in stations
    )  # fmt: skip


def memory_growth(rows: Sequence[StintRow]) -> float:
    """Of the resident memory from the end of the warm-up to the end, both as the mean of a few stints, in [MiB]."""
    memory = np.array([row.memory for row in rows])
    warm = min(WARM_UP, len(rows) // 2)
    few = min(10, len(rows) - warm)
    return float(memory[-few:].mean() - memory[warm : warm + few].mean())


def resident_memory() -> float:
    """Of this process, in [MiB]; NaN where there is no /proc."""
    gc.collect()
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="utf-8").splitlines() if status.exists() else []
    return next((float(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS")), math.nan)


class _Timed(Wrapped):
    """A controller whose steps' processor time is taken, in [us]."""

    def __init__(self, controller: Controller):
        super().__init__(controller)
        self.times: list[float] = []

    def step(self, state: VehicleState) -> SteeringCommand:
        began = time.thread_time_ns()
        command = super().step(state)
        self.times.append((time.thread_time_ns() - began) / 1000.0)
        return command


def _drive(
    scenario: Scenario, plant: Plant, state: VehicleState, stint: int, seed: int
) -> tuple[StintRow, VehicleState]:
    s, _, _ = scenario.path.project(state.x, state.y)
    ahead = obstacles_ahead(scenario, s, seed + stint)
    now = replace(scenario, start=replace(state, time=0.0), obstacles=ahead)
    recording, first = _timed_drive(now, plant)
    stalled = _not_long_again(recording, first, now, plant)
    late = (first > _LONG) & ~stalled
    judgement = judge(recording, now)
    row = StintRow(
        stint, judgement.verdict.value, judgement.label, recording.end.value, judgement.touched,
        judgement.min_clearance if judgement.min_clearance is not None else math.inf,
        float(np.sum(np.hypot(np.diff(recording["x"]), np.diff(recording["y"])))), len(first),
        int(np.count_nonzero(late)), int(np.count_nonzero(stalled)), _not_finite(recording),
        float(first[~stalled].max(initial=0.0)), float(first[stalled].max(initial=0.0)), resident_memory(),
    )  # fmt: skip
    return row, _last(recording)


def _timed_drive(scenario: Scenario, plant: Plant) -> tuple[Recording, np.ndarray]:
    """The recording, and every controller step's processor time in [us]."""
    controller = _Timed(open_controller(scenario))
    return closed_loop(scenario, plant, controller), np.array(controller.times)


def _not_long_again(recording: Recording, times: np.ndarray, scenario: Scenario, plant: Plant) -> np.ndarray:
    """Whether a step was long, and was not when the same was driven again."""
    once = times > _LONG
    if not once.any():
        return once
    again, second = _timed_drive(scenario, plant)
    same = len(second) == len(times) and np.array_equal(again["x"], recording["x"])
    return once & (second <= _LONG) if same else np.zeros_like(once)


def _not_finite(recording: Recording) -> int:
    columns = [*recording.samples.values(), *(plan.states for plan in recording.plans)]
    return sum(int(np.count_nonzero(~np.isfinite(column))) for column in columns)


def _last(recording: Recording) -> VehicleState:
    names = ("time", "x", "y", "yaw", "v_x", "v_y", "yaw_rate", "steer_angle")
    return VehicleState(*(float(recording[name][-1]) for name in names))
