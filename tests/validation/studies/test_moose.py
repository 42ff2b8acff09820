"""ISO 3888-2: lanes from the car's width, rolling without drive or brakes, the search for the highest speed."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.stand_in import Feedback

from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters, vehicle_presets
from sidestep.validation.cli.main import main
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies import moose


@pytest.mark.parametrize("car", vehicle_presets())
def test_lanes_have_the_standard_s_dimensions(car):
    width = VehicleParameters.preset(car).width
    first, third, fifth = moose.lanes(width)
    lengths = [end - start for start, end, _, _ in (first, third, fifth)]
    assert lengths == pytest.approx([12.0, 11.0, 12.0])
    assert [third[0] - first[1], fifth[0] - third[1]] == pytest.approx([13.5, 12.5])
    assert fifth[1] - first[0] == pytest.approx(61.0)
    widths = [left - right for _, _, right, left in (first, third, fifth)]
    assert widths == pytest.approx([1.1 * width + 0.25, width + 1.0, 3.0])
    assert third[2] - first[3] == pytest.approx(1.0)  # facing edges
    assert fifth[2] == pytest.approx(first[2])
    assert first[2] == pytest.approx(-first[3])  # the car starts in the middle


def test_the_built_in_scenario_has_these_lanes():
    scenario = load_scenario("moose")
    config = scenario.controller
    boxes = moose.cones(scenario.vehicle.width, -config.width_right, config.width_left)
    for mine, built_in in zip(boxes, scenario.obstacles, strict=True):
        assert [mine.s, mine.l, mine.length, mine.width] == pytest.approx(
            [built_in.s, built_in.l, built_in.length, built_in.width], abs=1e-6
        )


def test_beside_the_lanes_everything_is_closed():
    boxes = moose.cones(1.61, -2.5, 6.0)
    for right, left in zip(boxes[::2], boxes[1::2], strict=True):
        assert right.l - right.width / 2.0 == pytest.approx(-2.5)
        assert left.l + left.width / 2.0 == pytest.approx(6.0)


@pytest.mark.parametrize("plant", ["linear", "single-track"])
def test_throttle_off_means_neither_drive_nor_brakes(plant):
    scenario = moose.scene(moose.CASES[0], plant, 60.0)
    with open_plant(moose.rolling(scenario)) as car:
        for target in (0.0, 40.0):
            straight = cosimulate(Feedback(speed=target), car, replace(scenario, duration=1.0))
            assert straight["v_x"] == pytest.approx(scenario.speed, abs=1.001 * moose.COASTING)


def test_the_tyres_drag_slows_the_rolling_car():
    scenario = moose.scene(moose.CASES[0], "single-track", 60.0)
    with open_plant(moose.rolling(scenario)) as car:
        bend = cosimulate(Feedback(aim=5.0, speed=40.0), car, replace(scenario, duration=2.0))
    assert scenario.speed - 3.0 < bend["v_x"][-1] < scenario.speed - 0.02


@pytest.mark.parametrize("limit", [19.0, 20.0, 47.3, 68.0, 110.0, 200.0])
def test_bisection_finds_the_highest_clean_speed(limit):
    bisected, speed = moose.highest(lambda v: v <= limit)
    if limit < moose.SLOWEST:
        assert (bisected, speed) == (0.0, 0.0)
    else:
        assert bisected == speed == min(np.floor(limit / moose.STEP) * moose.STEP, moose.FASTEST)


def test_a_slower_speed_that_fails_lowers_the_result():
    bisected, speed = moose.highest(lambda v: v <= 70.0 and not 43.0 < v < 47.0)
    assert bisected == 70.0
    assert speed == 40.0  # 45 is the first one that is not clean


@pytest.mark.closed_loop
def test_slow_is_clean_and_far_too_fast_is_not():
    assert moose.drive(moose.scene(moose.CASES[0], "single-track", 30.0)).clean
    fast = moose.drive(moose.scene(moose.CASES[0], "single-track", 110.0))
    assert not fast.clean


def test_standing_before_the_exit_is_not_clean():
    scenario = moose.scene(moose.CASES[0], "linear", 30.0)
    assert not moose.drive(replace(scenario, duration=2.0)).clean


def test_other_widths_make_other_lanes():
    scenario = moose.scene(moose.Case("wide", ("vehicle.width=1.8",)), "linear", 40.0)
    right, left = scenario.obstacles[:2]
    assert (left.l - left.width / 2.0) - (right.l + right.width / 2.0) == pytest.approx(1.1 * 1.8 + 0.25)
    assert scenario.start == VehicleState(v_x=40.0 / 3.6)


@pytest.mark.closed_loop
def test_the_command_writes_all_cases(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(moose, "FASTEST", 25.0)
    monkeypatch.setattr(moose, "STEP", 5.0)
    monkeypatch.setattr(moose, "CASES", (moose.CASES[0], moose.CASES[-1]))
    assert main(["limits", "moose", "--plant", "linear", "--jobs", "1", "--out", str(tmp_path)]) == 1  # 25 < 68
    result = json.loads((tmp_path / "moose.json").read_text())
    assert [row["case"] for row in result["rows"]] == ["default", "paper"]
    default = result["rows"][0]
    assert default["speed"] == default["bisected"] == 25.0
    assert "highest clean" in capsys.readouterr().out


@pytest.mark.parametrize("plant", ["mujco", "no.fmu"])
def test_a_plant_that_is_not_there_leaves_what_was_found_before(plant, tmp_path: Path, capsys):
    (tmp_path / "moose.csv").write_text("found before")
    assert main(["limits", "moose", "--plant", plant, "--out", str(tmp_path)]) == 2
    assert main(["limits", "moose", "--plant", plant, "--out", str(tmp_path / "new")]) == 2
    assert plant in capsys.readouterr().err
    assert (tmp_path / "moose.csv").read_text() == "found before"
    assert not (tmp_path / "new").exists()


def test_rows_outlive_what_ends_the_study(tmp_path: Path, monkeypatch):
    def find(case: moose.Case, plant: str, overrides: Sequence[str]) -> moose.MooseRow:
        if case is moose.CASES[2]:
            raise ZeroDivisionError
        return moose.MooseRow(case.name, plant, 30.0, 30.0, 0.1, 1.0, 0.0)

    monkeypatch.setattr(moose, "_highest", find)
    with pytest.raises(ZeroDivisionError):
        moose.moose(["mujoco"], [], 1, tmp_path, "")
    names = [line.split(",")[0] for line in (tmp_path / "moose.csv").read_text().splitlines()]
    assert names == ["case", "default", "body roll not known"]
