"""Scenes behind sensors: the truth, the state measured with noise, and what the state estimator makes of it.

    python benchmarks/perception/estimated_scenes.py [seeds] [plant ...]

`noisy` is the state of wander.py beside this file, straight to the controller; `filtered` the same through the filter;
`late` has no v_y and the pose at 10 Hz, 100 ms late, through the filter. Behind the filter, the controller learns
nothing by itself. The obstacles are known. The judge sees the truth.
"""

import math
import sys
from collections import deque
from dataclasses import astuple, fields, replace
from typing import Any

import numpy as np
from wander import FILTER, noisy, teach

from sidestep.controller.perception.estimator import Measurement, StateEstimator
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import Scenario, load_scenario
from sidestep.validation.studies import moose

LATE, POSE_STEPS = 5, 5
"""Age of a pose and steps from one to the next, in control periods of 20 ms."""
FILTERED = ("filtered", "late")
NAMES = tuple(f.name for f in fields(VehicleState))


class Sensors:
    """A controller behind sensors; `kind` as in the head of the file."""

    def __init__(self, scenario: Scenario, kind: str, seed: int, filtered: StateEstimator):
        config = replace(scenario.controller, reject_disturbance=kind not in FILTERED)
        self.controller = bare_controller(replace(scenario, controller=config))
        self.kind, self.seed, self.filtered = kind, seed, filtered

    @property
    def plan(self) -> Any:
        return self.controller.plan

    def reset(self) -> None:
        self.controller.reset()
        self.filtered.reset()
        self.random, self.past = np.random.default_rng(self.seed), deque[VehicleState](maxlen=LATE + 1)
        self.steps = 0

    def step(self, state: VehicleState) -> SteeringCommand:
        seen = noisy(state, self.random) if self.kind != "truth" else state
        if self.kind in FILTERED:
            told = dict(zip(NAMES, astuple(seen), strict=True))
            if self.kind == "late":
                told |= self._late(seen)
            seen = self.filtered.step(Measurement(**told))
            teach(self.controller, self.filtered)
        command = self.controller.step(seen)
        self.filtered.tell(command.steer_angle)
        self.steps += 1
        return command

    def _late(self, seen: VehicleState) -> dict[str, float]:
        """The start is known; then a pose comes every 0.1 s."""
        self.past.append(seen)
        if self.steps % POSE_STEPS and self.steps:
            return dict.fromkeys(("x", "y", "yaw", "v_y"), math.nan)
        old = self.past[0]
        return {"x": old.x, "y": old.y, "yaw": old.yaw, "pose_time": old.time, "v_y": math.nan}


def scenes(plant: str) -> list[Scenario]:
    named = [load_scenario(name, [f"plant.kind={plant}"]) for name in ("single-obstacle", "double-obstacle")]
    return [*named, moose.scene(moose.CASES[0], plant, 60.0)]


def row(scenario: Scenario, kind: str, seeds: int, filtered: StateEstimator) -> str:
    passed, gaps, sides, unsolved = 0, [], [], []
    for seed in range(1 if kind == "truth" else seeds):
        with open_plant(scenario) as plant:
            recording = cosimulate(Sensors(scenario, kind, seed, filtered), plant, scenario)
        judgement = judge(recording, scenario)
        passed += judgement.passed
        gaps.append(math.inf if judgement.min_clearance is None else judgement.min_clearance)
        sides.append(np.abs(recording["lateral_acceleration"]).max())
        unsolved.append(recording.infeasible_steps)
    return f"{passed:3d}/{len(gaps)} {min(gaps):7.3f} {np.mean(sides):6.2f} {max(sides):6.2f} {np.mean(unsolved):6.1f}"


def main(seeds: int, plants: list[str]) -> None:
    print("passed, least clearance [m], peak lateral acceleration [m/s^2] mean and most, infeasible steps a drive")
    for plant in plants:
        for scenario in scenes(plant):
            config = replace(FILTER, v_x_noise=0.05)
            filtered = StateEstimator(scenario.vehicle, config)
            for kind in ("truth", "noisy", "filtered", "late"):
                print(f"{plant:13s} {scenario.name:16s} {kind:9s} {row(scenario, kind, seeds, filtered)}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10, sys.argv[2:] or ["linear", "single-track", "mujoco"])
