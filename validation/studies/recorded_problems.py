"""The QPs of real drives: what the solvers are held against, and timed on."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller import SteeringController
from sidestep.controller.mpc import active_set
from sidestep.controller.mpc.mpc import UNCONSTRAINED, Mpc, Problem
from sidestep.controller.mpc.qp import SLACK_UNIT
from sidestep.plant_models.signals import VehicleState
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.random_scenes import random_scene
from sidestep.validation.scenarios.scenario import Scenario, load_scenario, parse_scenario

Array = NDArray[np.float64]

SCENES = ("moose", "double-obstacle", "s-curve")
SEEDS = (1, 2, 3)
"""Of the random scenes."""
HOSTILE_STEPS = 300


class Recorded(NamedTuple):
    """One step's QP, as each solver takes it.

    Attributes:
        scene, step: Where it is from; the steps of a scene follow each other.
        lines: All of it, for the active set; slacks in metres and radians.
        rows: What the controller gave to PIQP last: the nearest bounds, and what was added.
        before: Moves by which the controller chose the rows.
        bounded: Whether a bound acts, so that the controller asked PIQP.
    """

    scene: str
    step: int
    lines: active_set.Problem
    rows: Problem
    before: Array
    bounded: bool


def record(mpc: Mpc, scene: str, step: int, before: Array, status: str) -> Recorded:
    """Copy what the last solve was about."""
    p = mpc.problem
    moves = len(before)
    values, slopes, low, high = (part.copy() for part in mpc.lines)
    lines = active_set.Problem(
        np.ascontiguousarray(p.P[:moves, :moves]), p.c[:moves].copy(), slopes, low - values, high - values,
        p.x_l[:moves].copy(), p.x_u[:moves].copy(), p.c[moves:] / SLACK_UNIT,
        np.diag(p.P)[moves:] / SLACK_UNIT**2, np.array(mpc.soft),
    )  # fmt: skip
    rows = Problem(*(getattr(p, name).copy(order="F") for name in Problem.__dataclass_fields__))
    return Recorded(scene, step, lines, rows, before, status != UNCONSTRAINED)


def drive(name: str, scenario: Scenario) -> Iterator[Recorded]:
    """The QPs of a drive on the linear plant."""
    period = scenario.controller.period
    controller = SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
    with open_plant(scenario) as plant:
        state = plant.reset(scenario.start)
        for step in range(round(scenario.duration / period)):
            before = _moves(controller)
            command = controller.step(state)
            yield from _of(controller, name, step, before)
            state = plant.step(command, period)


def hostile(seed: int, steps: int = HOSTILE_STEPS) -> Iterator[Recorded]:
    """The QPs of states that are finite and nothing else: each step the car is somewhere else."""
    scenario, random = load_scenario("double-obstacle"), np.random.default_rng(seed)
    controller = SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
    for step in range(steps):
        before = _moves(controller)
        size = 10.0 ** random.uniform(-2.0, 1.0)
        x, y, yaw, v_x, v_y, yaw_rate, angle = random.normal(0.0, (20.0, 1.0, 0.3, 10.0, 1.0, 0.5, 0.2)) * size
        controller.step(VehicleState(0.02 * step, 40.0 + x, y, yaw, abs(v_x), v_y, yaw_rate, angle))
        yield from _of(controller, "hostile", step, before)


def _moves(controller: SteeringController) -> Array:
    return controller._mpc.moves.copy() if isinstance(controller._mpc, Mpc) else np.zeros(0)


def _of(controller: SteeringController, name: str, step: int, before: Array) -> Iterator[Recorded]:
    """The last step's QP, if there was one."""
    plan = controller.plan
    if plan is not None and isinstance(controller._mpc, Mpc):
        yield record(controller._mpc, name, step, before, plan.solver_status)


def recorded(
    scenes: Sequence[str] = SCENES, seeds: Sequence[int] = SEEDS, hostile_seeds: Sequence[int] = (0,)
) -> list[Recorded]:
    """All of them, in the order they came."""
    linear = ["plant.kind=linear"]
    drives = [load_scenario(name, linear) for name in scenes]
    drives += [parse_scenario(random_scene(seed), f"scene {seed}", linear) for seed in seeds]
    steps = [step for scenario in drives for step in drive(scenario.name, scenario)]
    return steps + [step for seed in hostile_seeds for step in hostile(seed)]
