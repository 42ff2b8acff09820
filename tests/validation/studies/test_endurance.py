"""A day's drive, in a few seconds of it: the road is closed, stints join, growth is measured."""

import json
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sidestep.controller import SteeringController
from sidestep.validation.cli.main import main
from sidestep.validation.geometry import car_boxes, obstacle_boxes, signed_clearance
from sidestep.validation.loop import closed_loop
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import parse_scenario
from sidestep.validation.studies import endurance


def scenario():
    return parse_scenario(endurance._SCENE, "endurance")


def test_the_road_is_closed():
    path = scenario().path
    assert path.closed
    assert path.heading(path.length) - path.heading(0.0) == pytest.approx(math.tau)


@pytest.mark.parametrize("seed", range(12))
def test_obstacles_leave_a_way_or_room_to_stop(seed):
    now = scenario()
    boxes = endurance.obstacles_ahead(now, 100.0, seed)
    assert boxes == endurance.obstacles_ahead(now, 100.0, seed)
    x, y = now.path.to_cartesian(100.0, 0.0)
    car = car_boxes(now.vehicle, x, y, now.path.heading(100.0))
    width = now.vehicle.width + 2.0 * now.controller.buffer
    for box in boxes:
        assert signed_clearance(car, obstacle_boxes(now.path, box, np.zeros(1)))[0] > now.speed**2 / (2.0 * 3.0) - 5.0
        reach = (box.width * math.cos(box.heading) + box.length * abs(math.sin(box.heading))) / 2.0
        widest = max(4.0 - box.l - reach, 4.0 + box.l - reach)
        assert widest > width or box.width == 8.0


def row(stint: int, memory: float) -> endurance.StintRow:
    return endurance.StintRow(stint, "pass", "ok", "completed", False, 1.0, 480.0, 3000, 0, 0, 0, 500.0, 500.0, memory)


def test_growth_is_what_comes_after_the_warm_up():
    warm_up = [row(k, 100.0 + k) for k in range(endurance.WARM_UP)]
    flat = [row(k, 150.0) for k in range(100)]
    grown = [row(k, 150.0 + 0.1 * k) for k in range(100)]
    assert endurance.memory_growth([*warm_up, *flat]) == pytest.approx(0.0)
    assert endurance.memory_growth([*warm_up, *grown]) == pytest.approx(9.0)


@pytest.mark.parametrize(("slow", "repeats", "late"), [((0,), True, 0), ((0,), False, 1), ((0, 1), True, 1)])
def test_only_a_step_that_is_long_again_is_late(slow, repeats, late, monkeypatch):
    """The seventh step of these drives takes 12 ms of processor time; a plant that drifts does not repeat itself."""
    made = []

    class Slow(SteeringController):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            self.drive, self.count = len(made), 0
            made.append(self)

        def step(self, state):
            self.count += 1
            end = time.thread_time() + (0.012 if self.drive in slow and self.count == 7 else 0.0)
            while time.thread_time() < end:
                pass
            return super().step(replace(state, y=state.y + (0.0 if repeats else 0.01 * self.drive)))

    now = parse_scenario(endurance._SCENE, "endurance", ["duration=0.5", "plant.kind=linear"])
    with open_plant(now) as plant:
        endurance._drive(now, plant, now.start, 0, 0)  # load the kernels
        monkeypatch.setattr(closed_loop, "SteeringController", Slow)
        driven, _ = endurance._drive(now, plant, now.start, 0, 0)
    assert len(made) == 2
    assert (driven.late, driven.stalled, driven.steps) == (late, 1 - late, 50)
    assert (driven.longest_step > 12000.0) == bool(late)
    assert (driven.longest_stall > 12000.0) == (not late)


def test_stints_outlive_what_ends_the_drive(tmp_path, monkeypatch):
    (tmp_path / "endurance.json").write_text("of an earlier drive")
    rows = iter([row(0, 1.0), row(0, 1.0), row(1, 1.0)])  # the first is not counted
    monkeypatch.setattr(endurance, "_drive", lambda scenario, plant, state, *_: (next(rows), state))
    with pytest.raises(StopIteration):
        endurance.endurance(1.0, 0, "linear", [], tmp_path, "")
    assert [line.split(",")[0] for line in (tmp_path / "endurance.csv").read_text().splitlines()] == ["stint", "0", "1"]
    assert not (tmp_path / "endurance.json").exists()


@pytest.mark.closed_loop
def test_stints_join_and_the_command_counts(tmp_path: Path, capsys):
    arguments = ["--plant", "linear", "--hours", str(3.0 * endurance.STINT / 3600.0), "--out", str(tmp_path)]
    assert main(["limits", "endurance", *arguments, "--set", "duration=4.0"]) == 0
    result = json.loads((tmp_path / "endurance.json").read_text())
    assert [r["stint"] for r in result["rows"]] == [0, 1, 2]
    assert all(r["steps"] == 400 and r["not_finite"] == 0 and r["late"] == 0 for r in result["rows"])
    assert all(r["distance"] == pytest.approx(64.0, rel=0.05) for r in result["rows"])
    assert result["touched"] == 0
    assert "memory" in capsys.readouterr().out
