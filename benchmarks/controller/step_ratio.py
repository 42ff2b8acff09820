"""The controller's step beside that of another checkout, in turns, on the same recorded states.

    git worktree add ../before 2a1e5d0 && python benchmarks/controller/step_ratio.py ../before [rounds]

Each checkout has a process of its own, which waits while the other one works. A step's time is its median over all
rounds, which takes out what other programs do to the machine; printed are median and p99 of these, and their ratios.
"""

import importlib
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from time import perf_counter_ns

CASES = {
    "double-obstacle": ("double-obstacle", ()),
    "lane change where bounds act": ("moose", ("speed=16",)),
    "fifty obstacles": ("double-obstacle", ()),
}
SOLVERS = ("piqp", "active-set")
ROUNDS = 9


def scenario_of(case: str, solver: str, old: bool):
    if old:
        load_scenario = importlib.import_module("sidestep.validation.scenario").load_scenario
    else:
        from sidestep.validation.scenarios.scenario import load_scenario
    name, overrides = CASES[case]
    more = [] if old else [f"controller.solver={solver}"]
    return load_scenario(name, ["plant.kind=linear", *overrides, *more])


def boxes_of(case: str, scenario):
    from sidestep.plant_models.obstacle import Obstacle

    if case != "fifty obstacles":
        return scenario.obstacles
    beside = [Obstacle(4.0 * k, 3.7 if k % 2 else -3.7, 2.0, 0.4) for k in range(48)]
    return (*scenario.obstacles, *beside)


def serve(old: bool) -> None:
    """Answer each line with the times of one replay, in [us]."""
    from sidestep.controller import SteeringController
    from sidestep.plant_models.signals import VehicleState

    controllers = {}
    for line in sys.stdin:
        request = json.loads(line)
        key = request["case"], request["solver"]
        if key not in controllers:
            s = scenario_of(*key, old)
            controllers[key] = SteeringController(s.vehicle, s.path, boxes_of(key[0], s), s.controller)
        controller, times, bounded = controllers[key], [], []
        states = [VehicleState(*row) for row in request["states"]]
        controller.reset()
        for state in states:
            began = perf_counter_ns()
            controller.step(state)
            times.append((perf_counter_ns() - began) / 1000.0)
            bounded.append(controller.plan.solver_status != "UNCONSTRAINED")
        print(json.dumps({"times": times, "bounded": bounded}), flush=True)


def states_of(case: str) -> list[tuple[float, ...]]:
    """States of a drive on the linear plant."""
    from dataclasses import astuple

    from sidestep.controller import SteeringController
    from sidestep.validation.loop.plants import open_plant

    s = scenario_of(case, "active-set", False)
    controller, states = SteeringController(s.vehicle, s.path, boxes_of(case, s), s.controller), []
    with open_plant(s) as plant:
        state = plant.reset(s.start)
        for _ in range(min(300, round(s.duration / s.controller.period))):
            states.append(astuple(state))
            state = plant.step(controller.step(state), s.controller.period)
    return states


def worker(tree: Path, old: bool) -> subprocess.Popen:
    types = tree.resolve() / ".ci" / "types"
    environment = os.environ | {"PYTHONPATH": str(types)}
    command = [sys.executable, str(Path(__file__).resolve()), "--serve", "old" if old else "new"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)


def ask(process: subprocess.Popen, **request) -> dict:
    assert process.stdin
    assert process.stdout
    process.stdin.write(json.dumps(request) + "\n")
    process.stdin.flush()
    return json.loads(process.stdout.readline())


def quantiles(rows: list[list[float]], chosen: list[bool]) -> tuple[float, float]:
    quiet = sorted(
        statistics.median(column) for column, use in zip(zip(*rows, strict=True), chosen, strict=True) if use
    )
    return statistics.median(quiet), quiet[min(int(0.99 * len(quiet)), len(quiet) - 1)]


def main(other: Path, rounds: int) -> None:
    before, now = worker(other, True), worker(Path(__file__).resolve().parents[2], False)
    print(f"{'case':32}{'solver':12}{'before':>16}{'now':>16}{'ratio':>14}   [us], median / p99")
    for case in CASES:
        states = states_of(case)
        for solver in SOLVERS:
            runs: dict[str, list] = {"before": [], "now": []}
            for k in range(rounds + 1):  # the first loads the code
                for name, process in (("before", before), ("now", now)):
                    answer = ask(process, case=case, solver=solver, states=states)
                    if k:
                        runs[name].append(answer)
            acts = runs["now"][0]["bounded"] if "bounds" in case else [True] * len(states)
            (m0, p0), (m1, p1) = (quantiles([run["times"] for run in runs[name]], acts) for name in ("before", "now"))
            print(f"{case:32}{solver:12}{m0:8.1f}{p0:8.1f}{m1:8.1f}{p1:8.1f}{m1 / m0:7.2f}{p1 / p0:7.2f}", flush=True)
    for process in (before, now):
        assert process.stdin
        process.stdin.close()
        process.wait()


if __name__ == "__main__":
    if sys.argv[1] == "--serve":
        serve(sys.argv[2] == "old")
    else:
        main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else ROUNDS)
