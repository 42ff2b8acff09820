"""The offline optimum: it is one, by physics and by what it must keep clear of; peaks are measured alike."""

import sys
from pathlib import Path

import numpy as np
import pytest

import sidestep.validation
from sidestep.validation.cli.main import main
from sidestep.validation.geometry import car_boxes, obstacle_boxes, signed_clearance
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.optimum import JERK_BANDWIDTH, SCENES, Peaks, compare, low_passed, offline_optimum

BENCHMARKS = Path(sidestep.validation.__file__).parents[1] / "benchmarks" / "studies"


@pytest.fixture(scope="module")
def script():
    sys.path.insert(0, str(BENCHMARKS))
    import offline_optimum as script

    yield script
    sys.path.remove(str(BENCHMARKS))


@pytest.mark.parametrize("scene", SCENES)
def test_the_stored_optimum_is_found_again(script, scene):
    stored, scenario = offline_optimum()[scene], load_scenario(scene, ["plant.kind=linear"])
    found = script.solve(scenario, stored["sides"], 400)
    peaks = script.peaks_of(found)
    assert peaks.lateral_acceleration == pytest.approx(stored["lateral_acceleration"], rel=0.01)
    assert peaks.jerk == pytest.approx(stored["jerk"], rel=0.03)
    assert peaks.steer_rate == pytest.approx(stored["steer_rate"], rel=0.03)


@pytest.mark.parametrize("scene", SCENES)
def test_the_optimum_just_keeps_the_buffer(script, scene):
    scenario = load_scenario(scene)
    found = script.solve(scenario, offline_optimum()[scene]["sides"], 400)
    l, heading = found["states"][:, 0], found["states"][:, 1]  # noqa: E741
    car = car_boxes(scenario.vehicle, scenario.speed * found["time"], l, heading)
    gaps = [signed_clearance(car, obstacle_boxes(scenario.path, o, found["time"])).min() for o in scenario.obstacles]
    assert gaps == pytest.approx([scenario.controller.buffer] * len(gaps), abs=5e-3)  # small angles, nodes 0.3 m apart
    assert np.abs(found["states"][[0, -1]]).max() < 1e-6


def test_the_optimum_is_its_model_s_motion(script):
    """Lateral acceleration is that of the driven path: l'' on a straight road, for small heading."""
    scenario = load_scenario("single-obstacle")
    found = script.solve(scenario, [-1], 800)
    path_acceleration = np.gradient(np.gradient(found["states"][:, 0], found["time"]), found["time"])
    assert path_acceleration[5:-5] == pytest.approx(found["lateral_acceleration"][5:-5], abs=0.05)


def test_the_far_sides_cost_more(script):
    scenario = load_scenario("double-obstacle")
    near, far = (script.peaks_of(script.solve(scenario, sides, 400)) for sides in ([1, -1], [-1, 1]))
    assert far.lateral_acceleration > near.lateral_acceleration


def test_low_pass_keeps_slow_motion_and_removes_noise():
    time = np.arange(0.0, 8.0, 0.01)
    slow, fast = np.sin(2.0 * np.pi * 0.5 * time), np.sin(2.0 * np.pi * 6.0 * JERK_BANDWIDTH * time)
    inner = slice(100, -100)
    assert low_passed(time, slow)[inner] == pytest.approx(slow[inner], abs=0.01)
    assert np.abs(low_passed(time, fast)[inner]).max() < 0.01


def test_peaks_of_a_known_motion():
    time = np.arange(0.0, 10.0, 0.01)
    peaks = Peaks.of(time, 3.0 * np.sin(2.0 * time), -0.2 * np.cos(time))
    assert peaks.lateral_acceleration == pytest.approx(3.0, abs=1e-3)
    assert peaks.jerk == pytest.approx(6.0, rel=0.02)
    assert peaks.steer_rate == pytest.approx(0.2)


def test_a_drive_is_compared_with_its_own_scene():
    best = offline_optimum()["double-obstacle"]
    peaks = Peaks(1.1 * best["lateral_acceleration"], 1.4 * best["jerk"], 1.2 * best["steer_rate"])
    row = compare("double-obstacle", "linear", peaks)
    assert (row.acceleration_ratio, row.jerk_ratio, row.steer_rate_ratio) == pytest.approx((1.1, 1.4, 1.2))
    assert row.passed
    assert not compare("single-obstacle", "linear", Peaks(0.1, 0.1, 0.26)).passed


@pytest.mark.closed_loop
def test_the_command_drives_both_scenes(tmp_path: Path, capsys):
    assert main(["limits", "optimum", "--plant", "linear", "--out", str(tmp_path)]) in (0, 1)
    assert (tmp_path / "optimum.csv").read_text().count("\n") == 1 + len(SCENES)
    assert "offline optimum" in capsys.readouterr().out
