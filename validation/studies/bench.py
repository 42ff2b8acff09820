"""`sidestep bench`: what a step of controller, planner, QP solver, plant and CAN port costs on this machine.

Method: the double-obstacle scene is driven once on every plant, which times the plant's steps. The states of the
linear plant's drive are then replayed through a fresh controller in several passes, and the QPs of one pass through
every QP solver that is installed. Where no bound of the MPC acts the controller needs no solver; what a step costs
where one does is taken from a replay of the double lane change, too. One thread, garbage collector off, the first
pass thrown away. `median` and `p99` are over all steps of all passes; for `p99_quiet` the median over the passes is
taken of every step first, which keeps what the work of a step costs and drops what the scheduler adds now and then.
"""

import argparse
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.can_port.port import SteeringPort
from sidestep.controller.decision.decide import decide
from sidestep.controller.memory import restored
from sidestep.controller.mpc.piqp_solver import Problem
from sidestep.controller.perception.locate import locate
from sidestep.controller.records import STATE, WORK, record
from sidestep.controller.step import look_back
from sidestep.plant_models.errors import PlantError
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.console import progress_bar
from sidestep.validation.files import check_file, write_text, written_file
from sidestep.validation.judge.summary import strict_json
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.loop.plants import PLANT_KINDS, open_plant
from sidestep.validation.scenarios.scenario import Scenario, load_scenario
from sidestep.validation.studies.bench_table import print_figures, print_solvers
from sidestep.validation.studies.qp_solvers import installed_solvers, solve_all
from sidestep.validation.undisturbed import undisturbed

Array = NDArray[np.float64]

SCENE, BOUNDED_SCENE = "double-obstacle", "moose"
PASSES, SOLVER_PASSES = 21, 4
"""Replays of the states and of the QPs; the first of each only warms up."""

_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA", "RAYON")}
_VERSIONS = ("sidestep", "numpy", "numba", "piqp", "osqp", "daqp", "clarabel", "mujoco", "fmpy", "python-can")


@dataclass(frozen=True)
class Drive:
    """One drive of the scene.

    Attributes:
        states: That the controller was given.
        commands: That it answered.
        plant_us: Time of each plant step, in [us].
    """

    states: list[VehicleState]
    commands: list[SteeringCommand]
    plant_us: Array


def main(options: argparse.Namespace) -> int:
    """Run the command; in a process of its own if this one's libraries may use several threads."""
    if any(os.environ.get(name) != "1" for name in _ONE_THREAD):
        again = [sys.executable, "-m", "sidestep.validation", *shlex.split(options.command_line)[1:]]
        return subprocess.call(again, env={**os.environ, **_ONE_THREAD})
    file: Path | None = options.json
    check_file(file, "--json")
    with progress_bar("bench", 1.0) as progress:
        figures = measure(load_scenario(SCENE), progress=progress)
    print_figures(figures)
    if options.solvers:
        print_solvers(figures)
    if file:
        with written_file(file, "--json"):
            write_text(file, strict_json(figures))
    return 0


def measure(
    scenario: Scenario,
    passes: int = PASSES,
    solver_passes: int = SOLVER_PASSES,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, Any]:
    """All figures, as `--json` writes them.

    Args:
        scenario: The scene; its plant does not matter.
        passes, solver_passes: At least 2; the first of each is thrown away.
        progress: Called with the part of the work that is done.
    """
    machine = _machine()
    with undisturbed():
        drives = {kind: _drive(scenario, kind) for kind in PLANT_KINDS}
        progress(0.3)
        linear = drives["linear"]
        states = linear.states if linear else []
        problems = _problems(scenario, states)
        times = np.array([_replay(scenario, states) for _ in range(passes)])[1:]
        bounded = _bounded_steps(passes)
        progress(0.5)
        solved = {name: [solve_all(name, problems) for _ in range(solver_passes)] for name in installed_solvers()}
        progress(0.9)
        frame = _can_frame(linear.commands if linear else [])
    return {
        "controller_step_us": _quantiles(times[:, 0]),
        "bounded_step_us": _quantiles(bounded),
        "planner_us": _quantiles(times[:, 1]),
        "qp_us": {name: _quantiles(np.array([t for t, _ in runs[1:]])) for name, runs in solved.items()},
        "plant_us": {kind: _plant_figure(kind, drive) for kind, drive in drives.items()},
        "can_frame_us": frame,
        "solver_errors": _errors({name: runs[0][1] for name, runs in solved.items()}),
        "scene": {"name": scenario.name, "steps": len(states), "period_s": scenario.controller.period},
        "machine": machine,
        "versions": {name: _version(name) for name in _VERSIONS},
    }


def _drive(scenario: Scenario, kind: str) -> Drive | None:
    """Drive the scene on a plant; None where that cannot be built (an FMU without a C compiler)."""
    period, steps = scenario.controller.period, round(scenario.duration / scenario.controller.period)
    try:
        plant = open_plant(replace(scenario, plant=replace(scenario.plant, kind=kind)))
    except PlantError:
        return None
    controller, times = bare_controller(scenario), np.empty(steps)
    with plant:
        plant.step(controller.step(plant.reset(scenario.start)), period)  # load the kernels before the clock runs
        controller.reset()
        states, commands = [plant.reset(scenario.start)], []
        for k in range(steps):
            commands.append(controller.step(states[-1]))
            began = perf_counter_ns()
            states.append(plant.step(commands[-1], period))
            times[k] = (perf_counter_ns() - began) / 1000.0
    return Drive(states[:-1], commands, times)


def _replay(scenario: Scenario, states: Sequence[VehicleState]) -> Array:
    """Whole step as its caller sees it and path search in it, in [us], and solver's iterations; shape (3, steps)."""
    controller, times, work, now = bare_controller(scenario), np.empty((3, len(states))), record(WORK), record(STATE)
    for k, state in enumerate(states):
        memory, now[0] = restored(controller.save()), astuple(state)
        began = perf_counter_ns()
        controller.step(state)
        times[0, k] = (perf_counter_ns() - began) / 1000.0
        began = perf_counter_ns()
        _search(memory, controller.settings, scenario.path.table, scenario.path.period, controller.boxes, now, work)
        times[1, k] = (perf_counter_ns() - began) / 1000.0
        times[2, k] = controller.plan.iterations if controller.plan else 0.0
    return times


@kernel
def _search(memory, settings, table, period, boxes, states, work):
    """The part of a step that locates the car, searches the path and bounds the footprint."""
    m, c, w, state, road = memory[0], settings[0], work[0], states[0], (table, period)
    locate(m, w, c, road, state)
    look_back(m, w, c, state)
    decide(m, w, c, road, boxes, state, m.plans[1 - max(m.good, 0)])


def _bounded_steps(passes: int) -> Array:
    """Steps in which the solver is needed; shape (passes - 1, steps), in [us]."""
    scenario = load_scenario(BOUNDED_SCENE)
    drive = _drive(scenario, "linear")
    states = drive.states if drive else []
    times = np.array([_replay(scenario, states) for _ in range(passes)])[1:]
    return times[:, 0, times[0, 2] > 0]


def _problems(scenario: Scenario, states: Sequence[VehicleState]) -> list[Problem]:
    """The QP of every step, copied."""
    controller, problems = bare_controller(scenario), []
    for state in states:
        controller.step(state)
        if problem := controller.problem:
            problems.append(Problem(*(getattr(problem, f.name).copy(order="F") for f in fields(problem))))
    return problems


def _can_frame(commands: Sequence[SteeringCommand]) -> float:
    """Median time of one command from sender to decoded at the receiver, on the virtual bus, in [us]."""
    times = np.empty(len(commands))
    with SteeringPort("virtual:bench") as port:
        for k, command in enumerate(commands):
            began = perf_counter_ns()
            port.transmit(command)
            times[k] = (perf_counter_ns() - began) / 1000.0
    return float(np.median(times))


def _quantiles(times: Array) -> dict[str, float]:
    """Of times of shape (passes, steps), see the head of this file."""
    quiet = np.median(times, axis=0)
    return {
        "median": float(np.median(times)),
        "p99": float(np.percentile(times, 99)),
        "p99_quiet": float(np.percentile(quiet, 99)),
    }


def _plant_figure(kind: str, drive: Drive | None) -> float | None:
    """Median per control period; of MuJoCo per millisecond, which is its own step."""
    if drive is None:
        return None
    share = 1e-3 / (drive.states[1].time - drive.states[0].time) if kind == "mujoco" else 1.0
    return share * float(np.median(drive.plant_us))


def _errors(solutions: dict[str, list[Array]]) -> dict[str, float]:
    """Largest error of the steering rate that is applied next, against the exact optimum (DAQP's), in [rad/s]."""
    if "daqp" not in solutions:
        return {}
    exact = np.array([z[0] for z in solutions["daqp"]])
    return {name: float(np.abs(np.array([z[0] for z in found]) - exact).max()) for name, found in solutions.items()}


def _machine() -> dict[str, Any]:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor(),
        "cores": os.cpu_count(),
        "load_before": os.getloadavg()[0],
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
