"""Random scenes: the generator, what counts as a flip and as a failure, a few seeds from end to end."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.stand_in import straight_plan

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.signals import VehicleState
from sidestep.validation.cli.main import main
from sidestep.validation.geometry import obstacle_boxes, signed_clearance
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.random_scenes import MAX_CURVATURE, ROAD_ACCELERATION, SPEEDS, random_scene
from sidestep.validation.scenarios.scenario import Scenario, load_scenario, parse_scenario
from sidestep.validation.studies import scenes as scene_runs
from sidestep.validation.studies.scenes import COMMITMENT_TIME, PASSABLE, SceneRow, count_flips, run_scene, scenes

SEEDS = range(60)


@pytest.fixture(scope="module")
def drawn() -> list[Scenario]:
    return [parse_scenario(random_scene(seed), f"scene {seed}") for seed in SEEDS]


def test_a_seed_is_a_scene():
    assert random_scene(7) == random_scene(7)
    assert len({random_scene(seed) for seed in SEEDS}) == len(SEEDS)


def test_scenes_are_within_their_bounds(drawn):
    for scenario in drawn:
        assert SPEEDS[0] <= scenario.speed <= SPEEDS[1]
        assert 2 <= len(scenario.obstacles) <= 6
        curvature = np.abs(scenario.path.curvature(np.linspace(0.0, scenario.path.length, 500)))
        assert curvature.max() <= min(MAX_CURVATURE, ROAD_ACCELERATION / scenario.speed**2) + 1e-5
        assert scenario.path.length >= max(o.s + o.speed for o in scenario.obstacles)


def test_all_kinds_of_scene_come_up(drawn):
    boxes = [o for scenario in drawn for o in scenario.obstacles]
    assert any(o.speed > 0.0 for o in boxes)
    assert any(o.speed < 0.0 for o in boxes)
    assert any(o.heading != 0.0 for o in boxes)
    assert any(o.width > 6.0 for o in boxes)
    assert {len(scenario.obstacles) for scenario in drawn} == {2, 3, 4, 5, 6}


def test_moving_boxes_drive_into_nothing(drawn):
    times = np.linspace(0.0, 25.0, 251)
    for scenario in drawn[:20]:
        outlines = [obstacle_boxes(scenario.path, o, times) for o in scenario.obstacles]
        for i, a in enumerate(scenario.obstacles):
            for j, b in enumerate(scenario.obstacles[:i]):
                if a.speed != b.speed:
                    assert signed_clearance(outlines[i], outlines[j]).min() > 0.0


def flips(sides: list[int], time: list[float], speed: float = 10.0, stands: tuple[float, float] = (0.0, 0.0)) -> int:
    """For a box at s = 40 m, 4 m long, passed by a car at constant speed on a straight road.

    Its speedometer stands still between two times: it comes no nearer then.
    """
    box = Obstacle(40.0, 0.0, 4.0, 2.0)
    scenario = replace(load_scenario("single-obstacle"), obstacles=(box,))
    plans = [
        straight_plan(VehicleState(time=t))._replace(time=t, sides=(side,)) for t, side in zip(time, sides, strict=True)
    ]
    sampled = np.array([0.0, stands[0], stands[0] + 1e-9, stands[1], stands[1] + 1e-9, 100.0])
    samples = {"time": sampled, "s": sampled * speed, "v_x": speed * np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0])}
    return count_flips(Recording(samples, {}, plans), scenario)


def reached(speed: float = 10.0) -> float:
    """When the front bumper is at that box."""
    return (40.0 - 2.0 - load_scenario("single-obstacle").vehicle.front_extent) / speed


def test_a_flip_counts_from_the_commitment_until_the_box_is_passed():
    committed, beside = reached() - COMMITMENT_TIME + 0.01, reached() + 0.3
    assert flips([1, -1], [0.1, committed]) == 0
    assert flips([1, -1], [committed, committed + 0.1]) == 1
    assert flips([1, -1, 1], [committed, committed + 0.1, beside]) == 2
    assert flips([1, -1], [beside, reached() + 4.0 + 5.0 / 10.0]) == 0


def test_blocked_is_no_side_but_does_not_hide_a_flip():
    committed = reached() - COMMITMENT_TIME + 0.01
    assert flips([1, 0, 1], [committed, committed + 0.1, committed + 0.2]) == 0
    assert flips([1, 0, -1], [committed, committed + 0.1, committed + 0.2]) == 1


def test_a_box_that_is_not_approached_any_more_may_be_passed_on_either_side_later():
    committed = reached() - COMMITMENT_TIME + 0.01
    sides, time = [1, 1, -1], [committed, committed + 0.2, committed + 0.4]
    assert flips(sides, time) == 1
    assert flips(sides, time, stands=(committed + 0.1, committed + 0.3)) == 0


def test_a_slow_car_comes_closer_to_the_commitment_in_its_own_time():
    assert flips([1, -1], [reached(2.0) - 3.0, reached(2.0) - 2.5], speed=2.0) == 0
    assert flips([1, -1], [reached(2.0) - 1.5, reached(2.0) - 1.0], speed=2.0) == 1


def row(**values) -> SceneRow:
    usual = {
        "seed": 0, "speed": 10.0, "obstacles": 2, "moving": 0, "physics": "passable", "verdict": "pass",
        "label": "ok", "detail": "", "end": "end of the road", "touched": False, "min_clearance": 0.2,
        "min_edge_clearance": 1.0, "final_speed": 10.0, "max_lateral_acceleration": 2.0, "infeasible_steps": 0,
        "flips": 0, "error": "",
    }  # fmt: skip
    return SceneRow(**{**usual, **values})


@pytest.mark.parametrize(
    ("values", "failed"),
    [
        ({}, False),
        ({"label": "infeasible, handled"}, False),
        ({"label": "stopped, no way past", "physics": "stoppable"}, False),
        ({"verdict": "fail", "label": "collision", "touched": True}, True),
        ({"verdict": "fail", "label": "corridor violation", "physics": "stoppable", "touched": True}, True),
        ({"verdict": "fail", "label": "collision", "physics": "unavoidable", "touched": True}, False),
        ({"verdict": "fail", "physics": "unavoidable", "touched": True, "error": "ValueError: no"}, True),
        ({"verdict": "fail", "label": "stopped though passable"}, True),
        ({"verdict": "fail", "label": "stopped though passable", "physics": "stoppable"}, True),
        ({"verdict": "inconclusive", "label": "not passed in time"}, False),
        ({"flips": 1}, True),
        ({"flips": 1, "physics": "unavoidable"}, False),
    ],
)
def test_what_physics_allows_is_asked(values, failed):
    assert row(**values).failed is failed


@pytest.mark.closed_loop
def test_a_scene_gives_the_same_row_again():
    rows = [run_scene(4, "linear") for _ in range(2)]
    assert rows[0] == rows[1]
    assert rows[0].physics == "passable"
    assert not rows[0].failed


@pytest.mark.closed_loop
def test_the_command_writes_what_it_shows(tmp_path: Path, capsys):
    arguments = ["--plant", "linear", "--seed-from", "8", "--count", "2", "--jobs", "1", "--out", str(tmp_path)]
    assert main(["limits", "scenes", *arguments]) == 0
    assert "2 random scenes on linear" in capsys.readouterr().out
    result = json.loads((tmp_path / "scenes.json").read_text())
    assert result["passed"] is True
    assert [entry["seed"] for entry in result["rows"]] == [8, 9]
    assert sum(c["n"] for c in result["classes"].values()) == 2
    assert all(c["upper_bound_95"] is None or math.isfinite(c["upper_bound_95"]) for c in result["classes"].values())


@pytest.mark.parametrize(
    ("values", "status", "shown"),
    [
        ({"verdict": "fail", "label": "stopped though passable", "detail": "12 m of 90 m driven"}, 1, "1 of 2"),
        ({"verdict": "inconclusive", "label": "not passed in time"}, 1, "not passed in time"),
        ({}, 0, "0 of 2"),
    ],
)
def test_a_stop_though_passable_has_a_column_and_a_bound(values, status, shown, tmp_path, monkeypatch, capsys):
    rows = {7: row(seed=7), 8: row(seed=8, **values)}
    monkeypatch.setattr(scene_runs, "run_scene", lambda seed, plant, overrides: rows[seed])
    assert scenes([7, 8], "linear", [], 1, tmp_path, "") == status
    output = capsys.readouterr().out
    assert "stopped or slow" in output
    assert shown in output
    passable = json.loads((tmp_path / "scenes.json").read_text())["classes"]["passable"]
    held_back = int(values.get("verdict") == "fail")
    assert (passable["touched"], passable["held_back"]) == (0, held_back)
    assert passable["held_back_upper_bound_95"] == pytest.approx(0.975 if held_back else 0.776, abs=1e-3)


def test_rows_outlive_what_ends_the_study(tmp_path: Path, monkeypatch):
    def drive(seed: int, plant: str, overrides: Sequence[str]) -> SceneRow:
        if seed == 2:
            raise ZeroDivisionError
        return SceneRow(seed, 1.0, 2, 0, PASSABLE, "pass", "ok", "", "completed", False, 1.0, 1.0, 1.0, 1.0, 0, 0, "")

    monkeypatch.setattr(scene_runs, "run_scene", drive)
    with pytest.raises(ZeroDivisionError):
        scenes(range(4), "linear", [], 1, tmp_path, "")
    assert [line.split(",")[0] for line in (tmp_path / "scenes.csv").read_text().splitlines()] == ["seed", "0", "1"]


def test_no_scene_is_bad_usage(tmp_path: Path, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["limits", "scenes", "--count", "0", "--out", str(tmp_path / "x")])
    assert stopped.value.code == 2
    assert "--count" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_bad_input_shows_before_anything_runs():
    with pytest.raises(InputError, match=r"scene 3: controller\.nothing"):
        run_scene(3, "linear", ["controller.nothing=1"])
