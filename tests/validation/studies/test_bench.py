"""The bench's arithmetic, its solvers against each other, and its output; never how fast anything is."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

from sidestep.controller.mpc.piqp_solver import Problem
from sidestep.plant_models import PlantError
from sidestep.validation.cli.main import main
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies import bench
from sidestep.validation.studies.bench_table import print_figures, print_solvers
from sidestep.validation.studies.qp_solvers import installed_solvers, solve_all


@pytest.fixture(scope="module")
def scenario():
    return replace(load_scenario("double-obstacle"), duration=0.6)


@pytest.fixture(scope="module")
def problems(scenario):
    drive = bench._drive(scenario, "linear")
    assert drive is not None
    return bench._problems(scenario, drive.states)


@pytest.fixture(scope="module")
def figures(scenario):
    return bench.measure(scenario, passes=3, solver_passes=2)


def test_quiet_p99_drops_what_comes_in_one_pass_only():
    work = np.tile(np.arange(200.0), (5, 1))
    disturbed = work.copy()
    disturbed[np.arange(5), [3, 50, 70, 90, 120]] += 1e4
    assert bench._quantiles(work)["p99_quiet"] == bench._quantiles(work)["p99"] == np.percentile(np.arange(200.0), 99)
    assert bench._quantiles(disturbed)["p99_quiet"] == bench._quantiles(work)["p99_quiet"]
    assert bench._quantiles(np.full((2, 4), 7.0)) == {"median": 7.0, "p99": 7.0, "p99_quiet": 7.0}


@pytest.mark.parametrize("name", installed_solvers())
def test_solvers_find_the_optimum_of_a_problem_with_a_known_one(name):
    """min (z - (3, -4))^2 / 2 with z0 + z1 <= 0, z0 <= 2, z1 >= -3 and an empty row: (2, -3)."""
    problem = Problem(
        P=np.eye(2, order="F"), c=np.array([-3.0, 4.0]), G=np.array([[1.0, 1.0], [0.0, 0.0]], order="F"),
        h_l=np.full(2, -np.inf), h_u=np.array([0.0, 1.0]), x_l=np.array([-9.0, -3.0]), x_u=np.array([2.0, np.inf]),
    )  # fmt: skip
    moved = replace(problem, h_u=np.array([-3.0, 1.0]))  # the optimum of the plane z0 + z1 = -3 is beyond z1's bound
    times, (first, second) = solve_all(name, [problem, moved])
    assert first == pytest.approx([2.0, -3.0], abs=1e-4)
    assert second == pytest.approx([0.0, -3.0], abs=1e-4)
    assert times.shape == (2,)
    assert (times > 0.0).all()


def test_solvers_agree_on_the_controllers_own_problems(problems):
    solutions = {name: solve_all(name, problems)[1] for name in installed_solvers()}
    errors = bench._errors(solutions)
    assert errors["daqp"] == 0.0
    assert all(errors[name] < 1e-4 for name in errors.keys() & {"piqp", "clarabel"})


def test_errors_need_the_exact_solver():
    assert bench._errors({"piqp": [np.zeros(3)]}) == {}


def test_recorded_problems_are_copies(problems):
    assert len({problem.c.tobytes() for problem in problems}) == len(problems) == 30


@pytest.mark.closed_loop
def test_figures_have_the_keys_that_scripts_rely_on(figures):
    assert {"controller_step_us", "planner_us", "qp_us", "plant_us", "can_frame_us"} <= figures.keys()
    assert list(figures["plant_us"]) == ["linear", "single-track", "double-track", "mujoco"]
    assert "piqp" in figures["qp_us"]
    steps = (figures[key] for key in ("controller_step_us", "bounded_step_us", "planner_us"))
    for times in (*steps, *figures["qp_us"].values()):
        assert 0.0 < times["median"] <= times["p99"]
    assert figures["planner_us"]["median"] < figures["controller_step_us"]["median"]
    assert figures["versions"]["sidestep"] == "0.1.0"
    json.dumps(figures, allow_nan=False)


@pytest.mark.closed_loop
def test_tables_show_every_figure(figures, capsys):
    print_figures(figures)
    print_solvers(figures)
    shown = capsys.readouterr().out
    for word in ("controller step", "single-track", "per 1 ms", "CAN frame", "rad/s", *figures["qp_us"]):
        assert word in shown


@pytest.mark.closed_loop
def test_a_plant_that_cannot_be_built_leaves_a_gap(scenario, monkeypatch, figures, capsys):
    def no_compiler(_):
        raise PlantError("no C compiler")

    monkeypatch.setattr(bench, "open_plant", no_compiler)
    assert bench._drive(scenario, "single-track") is None
    assert bench._plant_figure("single-track", None) is None
    print_figures({**figures, "plant_us": {**figures["plant_us"], "single-track": None}})
    assert "cannot be built here" in capsys.readouterr().out


def test_mujoco_counts_per_millisecond_and_the_others_per_period(scenario):
    states = [scenario.start, replace(scenario.start, time=0.02)]
    drive = bench.Drive(states, [], np.array([40.0, 60.0, 50.0]))
    assert bench._plant_figure("mujoco", drive) == pytest.approx(2.5)
    assert bench._plant_figure("linear", drive) == 50.0


@pytest.mark.closed_loop
def test_command_runs_in_a_process_with_one_thread(tmp_path, monkeypatch, figures, capsys):
    seen = {}

    def call(command, env):
        seen.update(env)
        monkeypatch.setattr(os, "environ", env)
        return main(command[3:])

    monkeypatch.setattr(bench.subprocess, "call", call)
    monkeypatch.setattr(bench, "measure", lambda scenario, progress: figures)
    file = tmp_path / "bench.json"
    assert main(["bench", "--json", str(file), "--solvers"]) == 0
    assert seen["OPENBLAS_NUM_THREADS"] == "1"
    assert json.loads(file.read_text()) == figures
    assert "QP solver" in capsys.readouterr().out


def test_unwritable_json_is_refused_before_measuring(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(os, "environ", {**os.environ, **bench._ONE_THREAD})
    monkeypatch.setattr(bench, "measure", lambda *_, **__: pytest.fail("measured"))
    assert main(["bench", "--json", str(tmp_path / "no-folder" / "bench.json")]) == 2
    assert capsys.readouterr().err.startswith("sidestep: --json: cannot write")


@pytest.mark.closed_loop
def test_json_that_is_a_folder_is_an_error_in_one_line(tmp_path, monkeypatch, figures, capsys):
    monkeypatch.setattr(os, "environ", {**os.environ, **bench._ONE_THREAD})
    monkeypatch.setattr(bench, "measure", lambda scenario, progress: figures)
    assert main(["bench", "--json", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
