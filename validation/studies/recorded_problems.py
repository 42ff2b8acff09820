"""The QPs of real drives: what the solvers are held against, and timed on."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller import SteeringController
from sidestep.controller.memory import restored
from sidestep.controller.mpc.piqp_solver import Problem
from sidestep.plant_models.signals import VehicleState
from sidestep.validation.loop.closed_loop import bare_controller
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
        work, settings: All of it, as the step stacked it, for the active set.
        rows: What the controller gave to PIQP: the nearest bounds, and what was added.
        before: Moves by which the controller chose the rows.
        bounded: Whether a bound acts, so that the controller asked PIQP.
    """

    scene: str
    step: int
    work: NDArray[np.void]
    settings: NDArray[np.void]
    rows: Problem
    before: Array
    bounded: bool


def _stepped(controller: SteeringController, state: VehicleState, name: str, step: int) -> Recorded | None:
    """Step a controller and copy what that was about; None if the state could not be used."""
    moves = int(controller.settings["grid"]["moves"][0])
    before = restored(controller.save())["moves"][0, :moves].copy()
    controller.step(state)
    plan, problem = controller.plan, controller.problem
    if plan is None or problem is None or plan.solver_status in ("", "INPUT"):
        return None
    rows = Problem(*(getattr(problem, field).copy(order="F") for field in Problem.__dataclass_fields__))
    bounded = plan.solver_status != "UNCONSTRAINED"
    return Recorded(name, step, controller.work.copy(), controller.settings, rows, before, bounded)


def drive(name: str, scenario: Scenario) -> Iterator[Recorded]:
    """The QPs of a drive on the linear plant."""
    period = scenario.controller.period
    controller = bare_controller(scenario)
    with open_plant(scenario) as plant:
        state = plant.reset(scenario.start)
        for step in range(round(scenario.duration / period)):
            if found := _stepped(controller, state, name, step):
                yield found
            state = plant.step(controller.command, period)


def hostile(seed: int, steps: int = HOSTILE_STEPS) -> Iterator[Recorded]:
    """The QPs of states that are finite and nothing else: each step the car is somewhere else."""
    scenario, random = load_scenario("double-obstacle"), np.random.default_rng(seed)
    controller = bare_controller(scenario)
    for step in range(steps):
        size = 10.0 ** random.uniform(-2.0, 1.0)
        x, y, yaw, v_x, v_y, yaw_rate, angle = random.normal(0.0, (20.0, 1.0, 0.3, 10.0, 1.0, 0.5, 0.2)) * size
        state = VehicleState(0.02 * step, 40.0 + x, y, yaw, abs(v_x), v_y, yaw_rate, angle)
        if found := _stepped(controller, state, "hostile", step):
            yield found


def recorded(
    scenes: Sequence[str] = SCENES, seeds: Sequence[int] = SEEDS, hostile_seeds: Sequence[int] = (0,)
) -> list[Recorded]:
    """All of them, in the order they came."""
    linear = ["plant.kind=linear"]
    drives = [load_scenario(name, linear) for name in scenes]
    drives += [parse_scenario(random_scene(seed), f"scene {seed}", linear) for seed in seeds]
    steps = [step for scenario in drives for step in drive(scenario.name, scenario)]
    return steps + [step for seed in hostile_seeds for step in hostile(seed)]
