"""Manoeuvres that the controller drives: lane changes after ISO 3888, random scenes, and any scenario.

ISO 3888-1 has three lanes of 15, 25 and 15 m, 1.1, 1.2 and 1.3 car widths and 0.25 m wide, 30 and 25 m apart; the right
edge of the middle one is OFFSET to the left of the others'. ISO 3888-2 is that of `sidestep limits moose`. The paper's
scenes are scenarios, as is a recorded track: its road is given by way-points.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from sidestep.plant_models.errors import InputError
from sidestep.validation.console import number
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.scenarios.library import built_in_scenarios
from sidestep.validation.scenarios.random_scenes import random_scene
from sidestep.validation.scenarios.scenario import Scenario, load_scenario, parse_scenario
from sidestep.validation.studies.moose import CASES, drive, highest, scene

LANES = ((0.0, 15.0, 1.1, 0.0), (45.0, 70.0, 1.2, 3.5), (95.0, 110.0, 1.3, 0.0))
"""Of ISO 3888-1: start and end [m], width as a multiple of the car's, right edge seen from that of the first [m]."""
ENTRY, MARGIN = 30.0, 0.25
"""Station of the entry, and what is added to a lane's width, in [m]."""
SPEEDS = (60.0, 70.0, 80.0, 90.0, 100.0)
"""Of ISO 3888-1, in [km/h]."""
SEEDS = 10
"""Random scenes that are driven."""
DRIVEN = ("iso-3888-1", "iso-3888-2", "random-scenes")
"""Beside these, every scenario."""


@dataclass(frozen=True)
class Driven:
    """What became of one drive: a name, the verdict, and what there is to say."""

    name: str
    verdict: Verdict
    text: str


def driven_manoeuvre(name: str, overrides: Sequence[str]) -> list[Driven]:
    """Drive a manoeuvre by its name.

    Args:
        name: One of DRIVEN, a built-in scenario, or a scenario file.
        overrides: `key=value`, as given to `--set`.

    Raises:
        InputError: No such manoeuvre, or a bad override.
    """
    if name == "iso-3888-1":
        return [_judged(f"{name}, {speed:g} km/h", iso_3888_1(speed, overrides)) for speed in SPEEDS]
    if name == "iso-3888-2":
        plant = load_scenario("moose", overrides).plant.kind
        bisected, clean = highest(lambda speed: drive(scene(CASES[0], plant, speed, overrides)).clean)
        return [
            Driven(
                name,
                Verdict.PASS if clean > 0.0 else Verdict.FAIL,
                f"clean up to {clean:g} km/h; {bisected:g} km/h bisected",
            )
        ]
    if name == "random-scenes":
        vehicle = load_scenario("moose", overrides).vehicle
        texts = {f"scene {seed}": random_scene(seed, vehicle) for seed in range(SEEDS)}
        return [_judged(label, parse_scenario(text, label, overrides)) for label, text in texts.items()]
    if name not in built_in_scenarios() and not name.endswith(".toml"):
        raise InputError("--manoeuvre", f"{name!r}", "one that `sidestep validate --manoeuvres` lists")
    return [_judged(name, load_scenario(name, overrides))]


def _judged(name: str, scenario: Scenario) -> Driven:
    recording, judgement = simulate(scenario)
    text = f"{judgement.label}, clearance {number(judgement.min_clearance, 'm', 3)}, {recording.end.value}"
    return Driven(name, judgement.verdict, text)


def iso_3888_1(speed: float, overrides: Sequence[str] = ()) -> Scenario:
    """The double lane change for the scenario's car.

    Args:
        speed: Held, in [km/h].
        overrides: `key=value`, as given to `--set`.

    Raises:
        InputError: Bad override.
    """
    width = load_scenario("moose", overrides).vehicle.width
    edge = -(1.1 * width + MARGIN) / 2.0  # right edge of the first lane, the road runs through its middle
    boxes = []
    for start, end, widths, offset in LANES:
        right = edge + offset
        left = right + widths * width + MARGIN
        for low, high in ((-_RIGHT, right), (left, _LEFT)):
            s, l = ENTRY + (start + end) / 2.0, (low + high) / 2.0  # noqa: E741 (the paper's letter)
            boxes.append(f"{{ s = {s}, l = {l}, length = {end - start}, width = {high - low} }}")
    text = f"""
        name = "iso-3888-1"
        speed = {speed / 3.6}
        duration = {1.2 * _LENGTH / (speed / 3.6)}
        road = {{ width_left = {_LEFT}, width_right = {_RIGHT}, segments = [{{ type = "line", length = {_LENGTH} }}] }}
        controller = {{ buffer = 0.05 }} # the first lane leaves 0.2 m on each side
        obstacles = [{", ".join(boxes)}]
    """
    return parse_scenario(text, "iso-3888-1", overrides)


_LEFT, _RIGHT, _LENGTH = 7.0, 3.0, 180.0  # of the road, in [m]
