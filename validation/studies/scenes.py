"""`sidestep limits scenes`: random scenes driven, judged, and compared with what physics allows."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from rich.table import Table

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import Obstacle
from sidestep.validation.console import new_table, show
from sidestep.validation.files import made, write_text, written_to
from sidestep.validation.judge.feasibility import assess
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import End, Recording
from sidestep.validation.scenarios.random_scenes import random_scene
from sidestep.validation.scenarios.scenario import Scenario, parse_scenario
from sidestep.validation.studies.limits import (
    PLANT_OPTION,
    Outcome,
    counted,
    in_parallel,
    kept_rows,
    refuse_own,
    upper_bound,
    write_outcome,
)

COMMITMENT_TIME = 2.0
"""Before the front bumper reaches an obstacle: from then on its side may not change any more, in [s]."""

PASSABLE, STOPPABLE, UNAVOIDABLE = "passable", "stoppable", "unavoidable"


@dataclass(frozen=True)
class SceneRow:
    """One scene, flat.

    Attributes:
        seed: Of the scene.
        speed: At the start, in [m/s].
        obstacles, moving: How many boxes there are, and how many of them move.
        physics: "passable" at constant speed, for a clearance of `feasibility.MARGIN`; else "stoppable"; else
            "unavoidable".
        verdict, label, detail, end: See Judgement and Recording.
        touched: Whether something was hit, the road left, or the run broke off.
        min_clearance, min_edge_clearance: To obstacles and edges, in [m].
        final_speed: In [m/s].
        max_lateral_acceleration: In [m/s^2].
        infeasible_steps, flips: Steps without a feasible problem, and changes of side after commitment.
        error: What was raised, if anything.
    """

    seed: int
    speed: float
    obstacles: int
    moving: int
    physics: str
    verdict: str
    label: str
    detail: str
    end: str
    touched: bool
    min_clearance: float
    min_edge_clearance: float
    final_speed: float
    max_lateral_acceleration: float
    infeasible_steps: int
    flips: int
    error: str

    @property
    def held_back(self) -> bool:
        """Whether the car stopped, crept or was not driven as asked, where there was a way past."""
        return self.verdict == Verdict.FAIL.value and not self.touched

    @property
    def inconclusive(self) -> bool:
        """Whether the drive shows nothing."""
        return self.verdict == Verdict.INCONCLUSIVE.value

    @property
    def failed(self) -> bool:
        """Whether physics would have allowed better, or a decision was not kept."""
        avoidable = self.physics != UNAVOIDABLE and (self.touched or self.flips > 0)
        return bool(self.error) or avoidable or self.held_back


def scenes(seeds: Sequence[int], plant: str, overrides: Sequence[str], jobs: int, out: Path, command_line: str) -> int:
    """Drive the scenes of `seeds`, print a table, write the rows and every scene that failed.

    Args:
        seeds: One scene each.
        plant: As in a scenario file.
        overrides: `key=value`, as given to `--set`.
        jobs: Processes, -1 for one per core.
        out: Folder for scenes.json, scene-SEED.toml, and scenes.csv, which has every row as soon as it and those
            before it are there.
        command_line: For the JSON file.

    Returns:
        Exit status: 0 if nothing failed that physics would have allowed, and every drive shows something.

    Raises:
        InputError: Bad override or plant, folder that takes no files, or no seed at all.
    """
    if not seeds:
        raise InputError("--count", "no scene", ">= 1")
    refuse_own(overrides, PLANT_OPTION)
    open_plant(_scenario(seeds[0], plant, overrides)).close()  # bad input shows here, before any process starts
    calls = [partial(run_scene, seed, plant, overrides) for seed in seeds]
    with made(out):
        rows = in_parallel(f"scenes on {plant}", calls, jobs, kept_rows(out, "scenes"))
    failed = [row for row in rows if row.failed]
    with written_to(out):
        for row in failed:
            write_text(out / f"scene-{row.seed}.toml", random_scene(row.seed))
    told = [row for row in rows if row.failed or row.inconclusive]
    write_outcome(out, Outcome("scenes", _summary(rows), rows, not told), command_line)
    show(_table(rows, plant), *(_line(row) for row in told))
    return 1 if told else 0


def run_scene(seed: int, plant: str, overrides: Sequence[str] = ()) -> SceneRow:
    """Generate, assess, drive and judge scene `seed`: a pure function."""
    scenario = _scenario(seed, plant, overrides)
    (recording, judgement), physics = simulate(scenario), assess(scenario)
    allowed = PASSABLE if physics.passable else STOPPABLE if physics.stoppable else UNAVOIDABLE
    return SceneRow(
        seed=seed,
        speed=scenario.speed,
        obstacles=len(scenario.obstacles),
        moving=sum(o.speed != 0.0 for o in scenario.obstacles),
        physics=allowed,
        verdict=judgement.verdict.value,
        label=judgement.label,
        detail=judgement.detail,
        end=recording.end.value,
        touched=judgement.touched,
        min_clearance=judgement.min_clearance if judgement.min_clearance is not None else np.inf,
        min_edge_clearance=judgement.min_edge_clearance,
        final_speed=float(recording["v_x"][-1]),
        max_lateral_acceleration=float(np.abs(recording["lateral_acceleration"]).max()),
        infeasible_steps=recording.infeasible_steps,
        flips=count_flips(recording, scenario),
        error=f"{type(recording.error).__name__}: {recording.error}" if recording.error else "",
    )


def _scenario(seed: int, plant: str, overrides: Sequence[str]) -> Scenario:
    return parse_scenario(random_scene(seed), f"scene {seed}", [*overrides, f"plant.kind={plant}"])


def count_flips(recording: Recording, scenario: Scenario) -> int:
    """Changes from passing left to passing right or back, from COMMITMENT_TIME before each obstacle until it is passed.

    A car that falls back behind a moving obstacle is free to decide anew when it comes near again. Steps in which
    the obstacle blocks the way (side 0) count as neither.
    """
    if not recording.plans:
        return 0
    time = np.array([plan.time for plan in recording.plans])
    sides = np.array([plan.sides for plan in recording.plans])
    s, v = (np.interp(time, recording["time"], recording[name]) for name in ("s", "v_x"))
    return sum(
        _flips(sides[:, m], _is_close(obstacle, time, s, v, scenario)) for m, obstacle in enumerate(scenario.obstacles)
    )


def _flips(sides: np.ndarray, close: np.ndarray) -> int:
    approach = np.cumsum(np.diff(close, prepend=False))  # falling back behind an obstacle ends the commitment
    taken = close & (sides != 0)
    changed = (np.diff(sides[taken]) != 0) & (np.diff(approach[taken]) == 0)
    return int(np.count_nonzero(changed))


def _is_close(obstacle: Obstacle, time: np.ndarray, s: np.ndarray, v: np.ndarray, scenario: Scenario) -> np.ndarray:
    ahead = obstacle.s + obstacle.speed * time - s
    reach = 0.5 * (abs(obstacle.length * np.cos(obstacle.heading)) + abs(obstacle.width * np.sin(obstacle.heading)))
    before = ahead - reach - scenario.vehicle.front_extent
    behind = ahead + reach + scenario.vehicle.rear_extent < 0.0
    return (before <= COMMITMENT_TIME * np.maximum(v - obstacle.speed, 0.0)) & ~behind


def _summary(rows: Sequence[SceneRow]) -> dict[str, object]:
    """Per class of physics: n, k and the upper bound; over all: flips and errors."""
    classes = {}
    for physics in (PASSABLE, STOPPABLE, UNAVOIDABLE):
        of = [row for row in rows if row.physics == physics]
        classes[physics] = {"n": len(of), **_bounded("touched", sum(row.touched for row in of), len(of)),
                            **_bounded("held_back", sum(row.held_back for row in of), len(of))}  # fmt: skip
    return {
        "classes": classes,
        "inconclusive": sum(row.inconclusive for row in rows),
        "flips": sum(row.flips for row in rows),
        "errors": sum(bool(row.error) for row in rows),
        "failed_seeds": [row.seed for row in rows if row.failed],
    }


def _bounded(name: str, count: int, runs: int) -> dict[str, object]:
    """A count and the upper bound of its rate; no bound without a run."""
    bound = upper_bound(count, runs) if runs else None
    return {name: count, "upper_bound_95" if name == "touched" else f"{name}_upper_bound_95": bound}


def _table(rows: Sequence[SceneRow], plant: str) -> Table:
    table = new_table(
        f"{len(rows)} random scenes on {plant}", "physics allows", "drove on", "stopped or\nfollowed",
        "touched something", "stopped or slow\nthough passable", "incon-\nclusive", "flips", "errors",
    )  # fmt: skip
    for physics, meaning in _MEANINGS.items():
        of = [row for row in rows if row.physics == physics]
        clean = [row for row in of if row.verdict == Verdict.PASS.value]
        on = sum(row.end == End.END_OF_ROAD.value for row in clean)
        table.add_row(
            meaning, str(on), str(len(clean) - on), counted(sum(row.touched for row in of), len(of)),
            counted(sum(row.held_back for row in of), len(of)), str(sum(row.inconclusive for row in of)),
            str(sum(row.flips for row in of)), str(sum(bool(row.error) for row in of)),
        )  # fmt: skip
    return table


_MEANINGS = {PASSABLE: "a way past all", STOPPABLE: "only a stop", UNAVOIDABLE: "neither"}


def _line(row: SceneRow) -> str:
    return (
        f"seed {row.seed}: {row.verdict}: {row.label} at {row.speed} m/s where physics allows "
        f"{_MEANINGS[row.physics]}, clearance {row.min_clearance:.2f} m, edge {row.min_edge_clearance:.2f} m, "
        f"{row.flips} flips {row.error or row.detail}"
    )
