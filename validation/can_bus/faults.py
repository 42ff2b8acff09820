"""`sidestep can faults`: seeded faults in virtual time, and whether anything unsafe passes."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from sidestep.controller import SteeringController
from sidestep.controller.can_port.bus.faults import FaultSpec
from sidestep.controller.can_port.codec.database import CYCLE, Frame
from sidestep.controller.can_port.codec.messages import (
    STEER_CMD,
    ActuatorState,
    decode_steer_command,
)
from sidestep.controller.can_port.link import VirtualTimeLink
from sidestep.controller.can_port.nodes import ControllerNode, VehicleNode
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.validation.can_bus.corruption import corrupt
from sidestep.validation.can_bus.drive import drive_over
from sidestep.validation.console import progress_bar
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import End, Recording
from sidestep.validation.scenarios.scenario import Scenario, load_scenario

_SCENES = ("single-obstacle", "double-obstacle")


class _Witness(ControllerNode):
    """A controller's node that remembers what it sent."""

    def __init__(self, controller: SteeringController):
        super().__init__(controller)
        self.sent: set[tuple[float, float, Status]] = set()

    def step(self, time: float, frames: Iterable[Frame]) -> list[Frame]:
        answer = super().step(time, frames)
        sent = next(data for frame_id, data in answer if frame_id == STEER_CMD.frame_id)
        command = decode_steer_command(sent, 0.0).command
        self.sent.add((command.steer_angle, command.target_speed, command.status))
        return answer


class _Suspect(VehicleNode):
    """A vehicle's node that remembers what its actuator accepted."""

    def __init__(self) -> None:
        super().__init__()
        self.accepted: set[tuple[float, float, Status]] = set()

    def step(
        self, state: VehicleState, frames: Iterable[Frame], valid: bool = True
    ) -> tuple[SteeringCommand, list[Frame]]:
        answer = super().step(state, frames, valid)
        if asked := self.actuator.asked:
            self.accepted.add((asked.steer_angle, asked.target_speed, asked.status))
        return answer


@dataclass(frozen=True)
class Outcome:
    """A finished case.

    Attributes:
        scenario, faults: What was driven, and what went wrong on the bus.
        recording: What happened.
        state: The actuator's at the end.
        foreign: Commands that it accepted although they were never sent.
    """

    scenario: Scenario
    faults: FaultSpec
    recording: Recording
    state: ActuatorState
    foreign: int


@dataclass(frozen=True)
class Kind:
    """Cases that have to end alike.

    Attributes:
        name: For the table.
        cases: Scenario and faults of each.
        demand: Whether an outcome is as it has to be.
    """

    name: str
    cases: list[tuple[Scenario, FaultSpec]]
    demand: Callable[[Outcome], bool]


def drive_case(scenario: Scenario, faults: FaultSpec, plant: Plant, controller: SteeringController) -> Outcome:
    """Drive one case in virtual time."""
    sender, vehicle = _Witness(controller), _Suspect()
    recording = drive_over(VirtualTimeLink(sender, faults), vehicle, plant, scenario)
    return Outcome(scenario, faults, recording, vehicle.actuator.state, len(vehicle.accepted - sender.sent))


def safe(outcome: Outcome) -> bool:
    """What holds for every case: nothing accepted that was not sent, wheels within limits, nothing raised."""
    vehicle, steering = outcome.scenario.vehicle, outcome.recording["steer_received"]
    return (
        outcome.foreign == 0
        and outcome.recording.error is None
        and bool(np.all(np.abs(steering) <= vehicle.steer_limit + 1e-9))
        and bool(np.all(np.abs(np.diff(steering)) <= vehicle.steer_rate_limit * CYCLE + 1e-6))
    )


def passes(outcome: Outcome) -> bool:
    """Driven as asked, whatever the bus did."""
    return judge(outcome.recording, outcome.scenario).passed


def stops(outcome: Outcome) -> bool:
    """Zero steering and a standing car that touched nothing; that there was a way past is not the bus's to see."""
    recording = outcome.recording
    at_rest = recording["steer_received"][-1] == recording["target_speed"][-1] == 0.0
    return bool(at_rest) and recording.end is End.STOPPED and not judge(recording, outcome.scenario).touched


def recovers(outcome: Outcome) -> bool:
    """Following again at the end."""
    return outcome.state is ActuatorState.ACTIVE


def is_caught(outcome: Outcome) -> bool:
    """No longer followed 50 ms after the sender froze, on the way to zero a cycle later, and back in the end."""
    time, recording = outcome.recording["time"], outcome.recording
    frozen = time - outcome.faults.start
    held = recording["status"][(frozen >= 0.05 - 1e-9) & (time < outcome.faults.end)]
    stopping = recording["target_speed"][(frozen >= 0.06 + CYCLE - 1e-9) & (time < outcome.faults.end)]
    return bool(np.all(held >= Status.DEGRADED)) and bool(np.all(stopping == 0.0)) and recovers(outcome)


def kinds(count: int, seed: int) -> list[Kind]:
    """`count` cases in all, most of them mixtures of everything."""
    scenes = [load_scenario(name, ["plant.kind=linear"]) for name in _SCENES]
    bodies = [load_scenario(name, ["plant.kind=mujoco"]) for name in _SCENES]
    short = [replace(scene, duration=1.1) for scene in scenes]
    each = max(1, count // 50)
    whole = _in_turn([*scenes, *bodies], each)
    named = [
        Kind("5 % loss", _seeded(whole, seed, loss=0.05), passes),
        Kind("5 % loss, 50 ms delay", _seeded(whole, seed, loss=0.05, delay=0.05), passes),
        Kind("50 % loss", _seeded(_in_turn(scenes, each), seed, loss=0.5, start=1.0), stops),
        Kind("frozen sender", [(short[i % 2], _freeze(seed + i)) for i in range(each)], is_caught),
        Kind("counter jumps", _seeded(_in_turn(short, each), seed, only=STEER_CMD.name, counter_jump=0.05), recovers),
        Kind("1 s blackout", _seeded(_for(2.0, scenes, each), seed, loss=1.0, start=0.4, end=1.4), recovers),
    ]
    rest = max(1, count - sum(len(kind.cases) for kind in named))
    mixtures = [(short[i % 2], mixture(seed + i)) for i in range(rest)]
    return [Kind("mixtures of everything", mixtures, recovers), *named]


def mixture(seed: int) -> FaultSpec:
    """A random mixture of all faults between 0.3 s and 0.7 s, but for counter jumps.

    Where the counters of the state's three messages jump apart for good, no sample is ever whole again: the
    controller keeps asking to stop, and that is as it has to be.
    """
    draw = Random(f"mixture {seed}")
    share = draw.choice((0.0, 0.02, 0.1, 0.3))
    some: Callable[[], float] = lambda: share * draw.choice((0.0, 0.5, 1.0))  # noqa: E731
    return FaultSpec(
        seed=seed, start=0.3, end=0.7, loss=some(), burst=draw.randint(1, 12), duplication=some(),
        delay=draw.choice((0.0, 0.01, 0.03, 0.05)), jitter=0.1 * some(), reorder=some(), corruption=some(),
        wrong_length=some(), masquerade=some(), freeze=draw.random() < 0.1,
        stuck=draw.random() < 0.1, flood=draw.randrange(4),
    )  # fmt: skip


def _in_turn(scenes: list[Scenario], count: int) -> list[Scenario]:
    return [scenes[i % len(scenes)] for i in range(count)]


def _for(duration: float, scenes: list[Scenario], count: int) -> list[Scenario]:
    return [replace(scene, duration=duration) for scene in _in_turn(scenes, count)]


def _seeded(scenes: list[Scenario], seed: int, **faults: Any) -> list[tuple[Scenario, FaultSpec]]:
    return [(scene, FaultSpec(seed=seed + i, **faults)) for i, scene in enumerate(scenes)]


def _freeze(seed: int) -> FaultSpec:
    start = 0.2 + 0.01 * (seed % 30)
    return FaultSpec(seed=seed, only=STEER_CMD.name, freeze=True, start=start, end=start + 0.4)


def campaign(count: int, corrupt_count: int, seed: int) -> int:
    """Run everything and print what came of it.

    Returns:
        Exit status: 0 if every case ended as it has to and no corrupt frame was accepted.
    """
    began, failed = time.perf_counter(), 0
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for head in ("cases", "n", "as it has to", "k not", "seeds of these"):
        table.add_column(head, justify="left" if head in ("cases", "seeds of these") else "right")
    everything = kinds(count, seed)
    total = sum(len(kind.cases) for kind in everything)
    with progress_bar("faults", total) as progress:
        done = 0
        for kind in everything:
            wrong = []
            for outcome in _outcomes(kind.cases):
                done += 1
                progress(done)
                if not (safe(outcome) and kind.demand(outcome)):
                    wrong.append(outcome.faults.seed)
            failed += len(wrong)
            n = len(kind.cases)
            table.add_row(kind.name, str(n), str(n - len(wrong)), str(len(wrong)), " ".join(map(str, wrong[:10])))
    took = time.perf_counter() - began
    fate = corrupt(corrupt_count, seed)
    console = Console(width=None if Console().is_terminal else 120)
    console.print(table)
    console.print(f"{total} cases in {took:.1f} s")
    console.print(fate.sentence(), highlight=False)
    return 0 if failed == fate.accepted == 0 else 1


def _outcomes(cases: list[tuple[Scenario, FaultSpec]]) -> Iterator[Outcome]:
    """One plant and one controller for all cases of a scenario."""
    kept: dict[str, tuple[Plant, SteeringController]] = {}
    try:
        for scenario, faults in cases:
            name = f"{scenario.name} {scenario.plant.kind}"
            if name not in kept:
                kept[name] = open_plant(scenario), bare_controller(scenario)
            yield drive_case(scenario, faults, *kept[name])
    finally:
        for plant, _ in kept.values():
            plant.close()


def one_case(spec: Path) -> int:
    """Drive both scenes with the faults of a file and print what came of it; 1 if anything unsafe passed."""
    faults = FaultSpec.from_file(spec)
    outcomes = list(_outcomes([(load_scenario(name, ["plant.kind=linear"]), faults) for name in _SCENES]))
    for outcome in outcomes:
        verdict = judge(outcome.recording, outcome.scenario)
        print(
            f"{outcome.scenario.name}: {verdict.label}, {outcome.recording.end.value} after "
            f"{outcome.recording['time'][-1]:.2f} s, actuator {outcome.state.name}, "
            f"{outcome.foreign} commands accepted that were never sent"
        )
    return 0 if all(map(safe, outcomes)) else 1
