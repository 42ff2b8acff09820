"""Campaigns: one scenario, many cases; which cases there are follows from the specification alone."""

import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from sidestep.plant_models.documents import read_toml
from sidestep.plant_models.errors import InputError
from sidestep.validation.loop.closed_loop import open_controller
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.library import read_scenario
from sidestep.validation.scenarios.random_scenes import random_scene
from sidestep.validation.scenarios.scenario import Scenario, parse_scenario
from sidestep.validation.scenarios.tables import Name, checked

RANDOM = "random"
"""Name of the scenario that is another scene for every case, after `random_scenes`."""

MOST_CASES = 1_000_000


@dataclass(frozen=True)
class Range:
    """What one key of the scenario file takes.

    Attributes:
        low, high: From and to, in the key's unit.
        steps: Of a grid, both ends included.
        values: Instead of these: any TOML values, one after the other.
    """

    low: float | None = None
    high: float | None = None
    steps: Annotated[int, Meta(ge=2)] = 5
    values: tuple[Any, ...] = ()

    def at(self, share: float) -> Any:
        """The value at 0 <= share < 1 of the way."""
        if self.values:
            return self.values[int(share * len(self.values))]
        assert self.low is not None
        assert self.high is not None
        return self.low + share * (self.high - self.low)

    @property
    def grid(self) -> tuple[Any, ...]:
        """All values of a grid."""
        return self.values or tuple(np.linspace(self.low or 0.0, self.high or 0.0, self.steps).tolist())


@dataclass(frozen=True)
class Campaign:
    """The specification: a TOML file's keys.

    Attributes:
        name: For folders and titles.
        scenario: A built-in one, a TOML file, or "random".
        method: "sobol" spreads `runs` cases evenly; "grid" takes every combination.
        runs: Cases of "sobol".
        seed: Of the cases' seeds and of where the Sobol sequence starts.
        failure_rate: Upper bound up to which the campaign passes; None: not a single failure.
        set: Keys of the scenario file that are the same for all cases, by their dotted names.
        vary: Those that are not.
        text: The scenario file's text; empty if random.
        file: Beside which the files that it names are found.
    """

    name: str
    scenario: str
    method: Literal["sobol", "grid"]
    runs: int
    seed: int
    failure_rate: float | None
    set: Mapping[str, Any]
    vary: Mapping[str, Range]
    text: str
    file: str


@dataclass(frozen=True)
class Case:
    """One run to be done: its number, its seed, and what the varied keys take."""

    row: int
    seed: int
    values: Mapping[str, Any]


@dataclass
class _File:
    name: Name
    scenario: str
    vary: dict[str, Any] = field(default_factory=dict)
    method: Literal["sobol", "grid"] = "sobol"
    runs: Annotated[int, Meta(ge=1, le=MOST_CASES)] = 100
    seed: Annotated[int, Meta(ge=0)] = 0
    failure_rate: Annotated[float, Meta(gt=0.0, lt=1.0)] | None = None
    set: dict[str, Any] = field(default_factory=dict)


def load_campaign(path: Path) -> Campaign:
    """Read a specification and the scenario file that it names.

    Raises:
        InputError: With file, dotted key and what is allowed.
        PlantError: A plant in it cannot be built.
    """
    tables = read_toml(path)
    try:
        campaign = _campaign(tables, path)
        _check_corners(campaign)
    except InputError as error:
        where = error.where.removeprefix("row 0: ")
        raise InputError(f"{path}: {where}", error.problem, error.allowed) from error
    return campaign


def _campaign(tables: dict[str, Any], path: Path) -> Campaign:
    top = _File(**checked(_File, {"name": path.stem, **tables}))
    file, text = (path, "") if top.scenario == RANDOM else read_scenario(top.scenario, path.parent)
    vary = {key: _range(table, f"vary.{key}") for key, table in _flat(top.vary)}
    campaign = Campaign(
        top.name, top.scenario, top.method, top.runs, top.seed, top.failure_rate, dict(_flat(top.set)),
        vary, text, str(file.absolute()),
    )  # fmt: skip
    if both := sorted(set(campaign.vary) & set(campaign.set)):
        raise InputError(f"vary.{both[0]}", "is also in [set]", "one of the two")
    if (count := number_of_cases(campaign)) > MOST_CASES:
        raise InputError("vary", f"{count} cases", f"at most {MOST_CASES}")
    return campaign


def _check_corners(campaign: Campaign) -> None:
    """Open what the corners of the ranges ask for: what no case could drive shows here, before any runs."""
    opened: list[Any] = []
    for case in corners(campaign):
        scenario = scenario_of(campaign, case)
        open_controller(scenario)
        plant = [scenario.tables.get(name) for name in ("plant", "vehicle")]
        if plant not in opened:
            open_plant(scenario).close()
            opened.append(plant)


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and what they hold; a table that is a range or empty is held, too."""
    for key, value in table.items():
        if isinstance(value, dict) and value and not set(value) & {"low", "high", "values"}:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _range(table: Any, where: str) -> Range:
    values = Range(**checked(Range, table, where))
    if not values.values and (values.low is None or values.high is None or not values.low < values.high):
        raise InputError(where, "is no range", "{ low = A, high = B } with A < B, or { values = [...] }")
    return values


def number_of_cases(campaign: Campaign) -> int:
    """How many runs the campaign has."""
    if campaign.method == "sobol":
        return campaign.runs
    return math.prod(len(values.grid) for values in campaign.vary.values())


def cases(campaign: Campaign) -> list[Case]:
    """All cases, in the order of their rows: a pure function of the specification."""
    count, keys = number_of_cases(campaign), list(campaign.vary)
    seeds = [int(child.generate_state(1)[0]) for child in np.random.SeedSequence(campaign.seed).spawn(count)]
    if campaign.method == "grid":
        rows = list(itertools.product(*(values.grid for values in campaign.vary.values())))
    else:
        rows = [
            [values.at(float(share)) for values, share in zip(campaign.vary.values(), point, strict=True)]
            for point in _sobol(count, len(keys), campaign.seed)
        ]
    return [
        Case(i, seed, dict(zip(keys, row, strict=True))) for i, (seed, row) in enumerate(zip(seeds, rows, strict=True))
    ]


def _sobol(count: int, dimensions: int, seed: int) -> np.ndarray:
    """The first points of a Sobol sequence, all shifted by one random vector; shape (count, dimensions)."""
    from scipy.stats import qmc  # takes a second, which the workers need not spend

    if not dimensions:
        return np.empty((count, 0))
    points = qmc.Sobol(dimensions, scramble=False).random_base2(math.ceil(math.log2(count)))[:count]
    return (points + np.random.default_rng(seed).random(dimensions)) % 1.0


def corners(campaign: Campaign) -> Iterator[Case]:
    """The first case with each key at either end of its range, or at each of its values; then it as it is."""
    first = cases(campaign)[0]
    for key, values in campaign.vary.items():
        for value in values.values or (values.low, values.high):
            yield replace(first, values={**first.values, key: value})
    yield first


def scenario_of(campaign: Campaign, case: Case, overrides: Sequence[str] = ()) -> Scenario:
    """What a case drives, with further `overrides`; its seed is that of the noise, and of the scene if that is random.

    Raises:
        InputError: A key or value that the scenario file cannot take.
    """
    values = {"plant.noise_seed": case.seed, **campaign.set, **case.values}
    text = campaign.text or random_scene(case.seed)
    own = [f"{key}={json.dumps(value)}" for key, value in values.items()]
    return parse_scenario(text, f"row {case.row}", [*own, *overrides], Path(campaign.file))
