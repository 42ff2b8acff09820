"""`sidestep limits moose`: ISO 3888-2, the highest speed at which the car enters and touches no cone, throttle off.

The lanes follow from the car's width w: section 1 is 1.1 w + 0.25 m wide and 12 m long, section 3 w + 1 m and 11 m,
section 5 3 m and 12 m, 13.5 m and 12.5 m apart; the facing edges of sections 1 and 3 are 1 m apart, sections 1 and 5
have their right edges in line. Beside the lanes everything is closed by boxes: a cone touched is a box touched.

Throttle off: the standard lets the car roll from the entry on, without braking. The plants follow a target speed; here
their speed control may neither drive nor brake, so that the tyres' drag alone slows the car, and the controller knows
that: its prediction would count on a stop that the car does not make. Before the entry the road is straight and nothing
acts on the car: the entry speed is the one at the start.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rich.table import Table

from sidestep.plant_models.obstacle import Obstacle
from sidestep.validation.console import new_table, number, show
from sidestep.validation.files import made
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import closed_loop, open_controller
from sidestep.validation.loop.delay_line import DelayLine
from sidestep.validation.loop.plants import ROLLING, open_plant
from sidestep.validation.scenarios.scenario import Scenario, load_scenario
from sidestep.validation.studies.limits import PLANT_OPTION, Outcome, in_parallel, kept_rows, refuse_own, write_outcome

ENTRY, SECTIONS = 20.0, (12.0, 13.5, 11.0, 12.5, 12.0)
"""Station of the entry and lengths of the sections, in [m]; the first, third and fifth are lanes."""
COASTING = 0.01
"""What is left to the plant's speed control, in [m/s^2]."""
CONE_HEIGHT = 0.5
"""The least that the standard allows, in [m]."""
SLOWEST, FASTEST, STEP, SCAN = 20.0, 110.0, 0.5, 5.0
"""Entry speeds that are tried: range, resolution, and spacing of the check below the highest, in [km/h]."""
OFFSET_SPEED, OFFSET_ANGLE, OFFSET_LOSS = 50.0, math.radians(1.0), 0.03
"""What a steering offset [rad] may take from the clearance [m] at this speed [km/h]."""


@dataclass(frozen=True)
class Case:
    """What is asked of the controller.

    Attributes:
        name: For the table.
        overrides: Of the scenario.
        delay: Between a command and its arrival at the plant, in [s].
        required: Entry speed that must be clean, in [km/h]; 0 for a baseline.
    """

    name: str
    overrides: tuple[str, ...] = ()
    delay: float = 0.0
    required: float = 0.0


CASES = (
    Case("default", required=68.0),
    Case("body roll not known", ("controller.body_roll=false",)),
    Case("delay 0.1 s, known", ("controller.input_delay_steps=5",), 0.1, required=60.0),
    Case("delay 0.1 s, not known", (), 0.1),
    Case("friction 0.6, known", ("plant.friction=0.6", "controller.friction=0.6"), required=50.0),
    Case("friction 0.6, not known", ("plant.friction=0.6",)),
    Case("linear tyres predicted", ("controller.tyre_model=linear",)),
    Case("paper", ("controller.preset=paper",)),
)
OFFSET_CASES = (Case("observed"), Case("not observed", ("controller.reject_disturbance=false",)))


@dataclass(frozen=True)
class MooseRow:
    """Result of one case on one plant; speeds in [km/h].

    Attributes:
        case, plant: What was driven.
        speed: Highest entry speed such that it and every lower one that was tried are clean; 0 if none is.
        bisected: Highest clean speed that the bisection found; above `speed` if something slower failed.
        clearance: To the nearest cone at `speed`, in [m].
        max_lateral_acceleration: At `speed`, in [m/s^2].
        required: See Case.
    """

    case: str
    plant: str
    speed: float
    bisected: float
    clearance: float | None
    max_lateral_acceleration: float | None
    required: float

    @property
    def passed(self) -> bool:
        """Whether the required speed was reached."""
        return self.speed >= self.required


@dataclass(frozen=True)
class OffsetRow:
    """What the steering offset costs on one plant: clearances without and with it, in [m]."""

    case: str
    plant: str
    straight: float
    offset: float

    @property
    def loss(self) -> float:
        """Clearance lost, in [m]."""
        return self.straight - self.offset


@dataclass(frozen=True)
class Drive:
    """One drive through the lanes.

    Attributes:
        clean: Whether no cone was touched and the car came out of the last lane.
        clearance: To the nearest cone, in [m].
        max_lateral_acceleration: In [m/s^2].
    """

    clean: bool
    clearance: float
    max_lateral_acceleration: float


def moose(plants: Sequence[str], overrides: Sequence[str], jobs: int, out: Path, command_line: str) -> int:
    """Find the highest clean entry speed of every case on every plant.

    Args:
        plants: As in a scenario file.
        overrides: `key=value`, as given to `--set`.
        jobs: Processes, -1 for one per core.
        out: Folder for moose.json and moose.csv, which has every row as soon as it and those before it are found.
        command_line: For the JSON file.

    Returns:
        Exit status: 0 if every required speed was reached and the offset costs no more than OFFSET_LOSS.

    Raises:
        InputError: Bad override or plant, or a folder that takes no files.
    """
    refuse_own(overrides, PLANT_OPTION | dict.fromkeys(("speed", "duration", "obstacles"), "the lanes of ISO 3888-2"))
    for plant in plants:  # bad input shows here, before any process starts
        open_plant(scene(CASES[0], plant, SLOWEST, overrides)).close()
    speed_calls = [partial(_highest, case, plant, overrides) for plant in plants for case in _possible(CASES, plant)]
    offset_calls = [partial(_offset, case, plant, overrides) for plant in plants for case in OFFSET_CASES]
    with made(out):
        rows = in_parallel("highest speed", speed_calls, jobs, kept_rows(out, "moose"))
        offsets = in_parallel("steering offset", offset_calls, jobs)
    held = all(row.loss <= OFFSET_LOSS for row in offsets if row.case == OFFSET_CASES[0].name)
    passed = held and all(row.passed for row in rows)
    summary = {"offset_loss_m": {f"{row.plant}, {row.case}": row.loss for row in offsets}}
    write_outcome(out, Outcome("moose", summary, rows, passed), command_line)
    show(_speed_table(rows), _offset_table(offsets))
    return 0 if passed else 1


def lanes(width: float) -> list[tuple[float, float, float, float]]:
    """Start, end, right and left edge of sections 1, 3 and 5 for a car of this width, in [m]."""
    first, third = (1.1 * width + 0.25), width + 1.0
    edge = first / 2.0
    sides = ((-edge, edge), (edge + 1.0, edge + 1.0 + third), (-edge, -edge + 3.0))
    starts = [ENTRY + sum(SECTIONS[:i]) for i in (0, 2, 4)]
    return [(s, s + SECTIONS[2 * i], *sides[i]) for i, s in enumerate(starts)]


def cones(width: float, road_right: float, road_left: float) -> tuple[Obstacle, ...]:
    """Boxes from the lanes' edges to those of the road."""
    boxes = []
    for start, end, right, left in lanes(width):
        for low, high in ((road_right, right), (left, road_left)):
            boxes.append(Obstacle((start + end) / 2.0, (low + high) / 2.0, end - start, high - low, height=CONE_HEIGHT))
    return tuple(boxes)


def scene(case: Case, plant: str, speed: float, overrides: Sequence[str] = ()) -> Scenario:
    """The lanes for the scenario's car, entered at `speed` [km/h].

    Raises:
        InputError: Bad override.
    """
    rolling = [f"controller.body_roll={str(plant in ROLLING).lower()}"]
    scenario = load_scenario(
        "moose", [*rolling, *overrides, *case.overrides, f"plant.kind={plant}", f"speed={speed / 3.6}"]
    )  # fmt: skip
    config = scenario.controller
    obstacles = cones(scenario.vehicle.width, -config.width_right, config.width_left)
    return replace(scenario, obstacles=obstacles, duration=2.0 * scenario.path.length / scenario.speed)


def rolling(scenario: Scenario) -> Scenario:
    """The scenario with the driver's feet off the pedals."""
    return replace(scenario, vehicle=scenario.vehicle.with_(max_acceleration=COASTING, max_braking=COASTING))


def drive(scenario: Scenario, delay: float = 0.0) -> Drive:
    """Through the lanes once, rolling."""
    coasting = rolling(scenario)
    with open_plant(coasting) as plant:
        recording = closed_loop(scenario, plant, open_controller(coasting), DelayLine(delay))
    judgement = judge(recording, scenario)
    out = recording["s"][-1] - scenario.vehicle.rear_extent > ENTRY + sum(SECTIONS)
    clearance = judgement.min_clearance if judgement.min_clearance is not None else math.inf
    return Drive(not judgement.touched and bool(out), clearance, float(abs(recording["lateral_acceleration"]).max()))


def highest(clean: Callable[[float], bool]) -> tuple[float, float]:
    """Highest clean speed: bisected, and such that all lower ones tried, SCAN apart, are clean; in [km/h]."""
    low, high = 0, round((FASTEST - SLOWEST) / STEP) + 1  # speed number `low` is clean, `high` is not
    if not clean(SLOWEST):
        return 0.0, 0.0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if clean(SLOWEST + middle * STEP) else (low, middle)
    found = SLOWEST + low * STEP
    below = SLOWEST
    while below + SCAN < found and clean(below + SCAN):
        below += SCAN
    return found, found if below + SCAN >= found else below


def _highest(case: Case, plant: str, overrides: Sequence[str]) -> MooseRow:
    drives: dict[float, Drive] = {}

    def clean(speed: float) -> bool:
        drives[speed] = drive(scene(case, plant, speed, overrides), case.delay)
        return drives[speed].clean

    bisected, speed = highest(clean)
    best = drives.get(speed)
    return MooseRow(
        case.name, plant, speed, bisected, best.clearance if best else None,
        best.max_lateral_acceleration if best else None, case.required,
    )  # fmt: skip


def _offset(case: Case, plant: str, overrides: Sequence[str]) -> OffsetRow:
    straight, offset = (
        drive(scene(case, plant, OFFSET_SPEED, [*overrides, f"plant.steer_offset={angle}"])).clearance
        for angle in (0.0, OFFSET_ANGLE)
    )
    return OffsetRow(case.name, plant, straight, offset)


def _possible(cases: Sequence[Case], plant: str) -> list[Case]:
    """Without those that the plant has no notion of: linear tyres do not slide, and not every plant rolls."""
    unknown = [*(["plant.friction=0.6"] if plant == "linear" else []),
               *([] if plant in ROLLING else ["controller.body_roll=false"])]  # fmt: skip
    return [case for case in cases if not set(unknown) & set(case.overrides)]


def _speed_table(rows: Sequence[MooseRow]) -> Table:
    table = new_table(
        "ISO 3888-2, throttle off", "controller", "plant", "highest clean\nentry [km/h]", "required",
        "clearance\n[m]", "max |a_y|\n[m/s²]", "",
    )  # fmt: skip
    for row in rows:
        note = f"{row.bisected:.1f} clean, too" if row.bisected > row.speed else ""
        colour = "green" if row.passed else "red"
        table.add_row(
            row.case, row.plant, f"[{colour}]{row.speed:.1f}[/]", f"{row.required:.0f}" if row.required else "",
            number(row.clearance, "", 3), number(row.max_lateral_acceleration, "", 2), note,
        )  # fmt: skip
    return table


def _offset_table(rows: Sequence[OffsetRow]) -> Table:
    table = new_table(
        f"Steering offset of 1° at {OFFSET_SPEED:.0f} km/h", "disturbance", "plant", "clearance without [m]",
        "with [m]", f"loss [cm], at most {100 * OFFSET_LOSS:.0f}",
    )  # fmt: skip
    for row in rows:
        table.add_row(row.case, row.plant, f"{row.straight:.3f}", f"{row.offset:.3f}", f"{100 * row.loss:.1f}")
    return table
