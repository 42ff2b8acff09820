import json
from dataclasses import replace

import numpy as np
import pytest
from support.stored_runs import drive

from sidestep.validation.report.compare.comparison import Line
from sidestep.validation.report.explore.scene_data import MOST_FRAMES, scene_data
from sidestep.validation.report.style import BLUE, ORANGE


@pytest.fixture(scope="module")
def collided():
    return drive()


def scene(run, *others, start=0.0):
    lines = [Line(f"car {i}", (BLUE, ORANGE)[i], one.recording) for i, one in enumerate((run, *others))]
    text = scene_data(run.scenario, lines, start)
    assert "<" not in text
    return json.loads(text)


def test_a_run_is_shown_from_end_to_end_with_the_plan_that_held(collided):
    data, recording = scene(collided), collided.recording
    times = data["times"]
    assert (times[0], times[-1]) == (0.0, pytest.approx(recording.steps["time"][-1]))
    assert len(times) <= MOST_FRAMES + 1
    (car,) = data["cars"]
    for name in ("x", "y", "yaw"):
        assert car[name] == pytest.approx(np.interp(times, recording["time"], recording[name]), abs=1e-3)
    assert car["steering"] == pytest.approx(
        np.degrees(np.interp(times, recording["time"], recording["steer_angle"])), abs=0.01
    )
    assert min(car["gap"]) < 0.0  # it collides
    assert len(data["plans"]) == len(times)
    vehicle = collided.scenario.vehicle
    assert sorted(car["outline"][0::2]) == pytest.approx(
        sorted([vehicle.front_extent, vehicle.front_extent, -vehicle.rear_extent, -vehicle.rear_extent]), abs=0.006
    )


def test_without_plans_the_cars_are_shown_all_the_same(collided):
    bare = replace(collided, recording=replace(collided.recording, plans=(), steps={}))
    data = scene(bare)
    assert data["plans"] == []
    assert data["times"][-1] == pytest.approx(collided.recording["time"][-1])


def test_a_car_whose_run_ended_stays_where_it_came_to(collided):
    short = drive(duration=1.0)
    data = scene(collided, short)
    assert data["times"][-1] > 5.0
    assert data["cars"][1]["x"][-1] == pytest.approx(short.recording["x"][-1], abs=1e-3)
    assert data["cars"][0]["colour"] == "var(--blue)"


def test_only_what_moves_is_kept_for_every_moment(collided):
    moving = drive(overrides=["obstacles.0.speed=5"], duration=2.0)
    assert [len(every) for every in scene(collided)["obstacles"]] == [1]
    data = scene(moving)
    (boxes,) = data["obstacles"]
    assert len(boxes) == len(data["times"])
    assert boxes[-1][0] - boxes[0][0] == pytest.approx(5.0 * data["times"][-1], abs=0.02)


def test_the_first_moment_lies_within_the_run(collided):
    assert scene(collided, start=-3.0)["start"] == 0.0
    assert scene(collided, start=1e9)["start"] == scene(collided)["times"][-1]
