"""How far a drive went, on drives whose answer is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.judge.progress import asked_drive, obstacles_ahead, progress
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.recording import SAMPLE_UNITS, STEP_UNITS, End, Recording
from sidestep.validation.scenarios.scenario import Scenario, load_scenario

SCENE = load_scenario("single-obstacle")
CAR = SCENE.vehicle


def scene(*obstacles: Obstacle, **changes) -> Scenario:
    return replace(SCENE, obstacles=obstacles, **changes)


def drive(speeds, beside: float = 2.4, told=None, end: End = End.COMPLETED) -> Recording:
    """Straight on at these speeds, one every 10 ms."""
    speeds = np.asarray(speeds, dtype=float)
    x = np.concatenate([[0.0], np.cumsum(speeds[:-1]) * 0.01])
    samples = {name: np.zeros(len(x)) for name in SAMPLE_UNITS}
    samples |= {"time": 0.01 * np.arange(len(x)), "x": x, "s": x, "y": np.full(len(x), beside), "v_x": speeds}
    samples["target_speed"] = speeds if told is None else np.broadcast_to(float(told), x.shape)
    return Recording(samples, {name: np.ones(1) for name in STEP_UNITS}, end=end)


BOX = Obstacle(40.0, 0.0, 4.5, 1.8)
STEADY = np.full(801, 15.0)


def test_reached_is_the_front_at_the_near_end_and_passed_the_rear_at_the_far_end():
    near, far = 40.0 - 2.25 - CAR.front_extent, 40.0 + 2.25 + CAR.rear_extent
    for station, reached, passed in (
        (near - 0.1, (), ()), (near + 0.1, (0,), ()), (far - 0.1, (0,), ()), (far + 0.1, (0,), (0,))
    ):  # fmt: skip
        went = progress(drive(STEADY[: math.ceil(station / 0.15) + 1]), SCENE)
        short = abs(went.distance - station) <= 0.15
        assert short
        if abs(went.distance - station) < 0.1:
            assert (went.reached, went.passed) == (reached, passed)


def test_the_asked_drive_keeps_the_speed_to_the_roads_end_or_the_time():
    assert asked_drive(SCENE, 0.0)[1][-1] == pytest.approx(15.0 * 8.0, abs=0.2)
    assert asked_drive(replace(SCENE, duration=20.0), 0.0)[1][-1] == pytest.approx(150.0, abs=0.2)
    slow = replace(SCENE, start=replace(SCENE.start, v_x=5.0))
    times, stations = asked_drive(slow, 0.0)
    speeds = np.diff(stations) / np.diff(times)
    assert speeds[0] == pytest.approx(5.0, abs=0.1)
    assert speeds[-1] == pytest.approx(15.0, abs=0.1)
    assert np.diff(speeds).max() / 0.01 <= CAR.max_acceleration + 1e-6


def test_what_is_ahead_on_the_road_and_slower_is_due():
    boxes = (
        BOX,
        Obstacle(-20.0, 0.0, 4.5, 1.8),  # behind
        Obstacle(60.0, 6.0, 4.5, 1.8),  # beside the road
        Obstacle(50.0, 0.0, 4.5, 1.8, speed=15.0),  # as fast
        Obstacle(90.0, 2.0, 4.5, 1.8, speed=-10.0),  # oncoming
    )
    assert obstacles_ahead(scene(*boxes), 0.0) == {0: 40.0, 4: 90.0}


def test_a_closed_road_brings_up_again_what_lies_behind():
    ring = ReferencePath.from_segments([Arc(math.tau * 50.0, 0.02)])
    assert obstacles_ahead(scene(BOX, path=ring), 100.0) == {0: pytest.approx(40.0 + math.tau * 50.0)}


@pytest.mark.parametrize(
    ("boxes", "speeds", "verdict", "label"),
    [
        ((BOX,), STEADY, Verdict.PASS, "ok"),
        ((), STEADY, Verdict.PASS, "ok"),
        ((BOX,), STEADY[:250], Verdict.FAIL, "slow though passable"),  # ended for no reason
        ((Obstacle(200.0, 0.0, 4.5, 1.8),), STEADY, Verdict.INCONCLUSIVE, "scene too short"),
        ((BOX, Obstacle(200.0, 0.0, 4.5, 1.8)), STEADY, Verdict.INCONCLUSIVE, "scene too short"),
        ((BOX, Obstacle(145.0, 0.0, 4.5, 1.8, speed=10.0)), STEADY, Verdict.PASS, "ok"),  # one of two, which drives
        ((Obstacle(145.0, 0.0, 4.5, 1.8, speed=10.0),), STEADY, Verdict.INCONCLUSIVE, "scene too short"),
        ((BOX,), np.linspace(15.0, 0.0, 401), Verdict.FAIL, "stopped though passable"),
        ((), np.full(801, 5.0), Verdict.FAIL, "slow though passable"),
        ((Obstacle(110.0, 0.0, 1.0, 8.0),), np.full(801, 9.0), Verdict.INCONCLUSIVE, "not passed in time"),
    ],
)  # fmt: skip
@pytest.mark.closed_loop
def test_how_far_a_drive_went_decides(boxes, speeds, verdict, label):
    judged = judge(drive(speeds), scene(*boxes))
    assert (judged.verdict, judged.label) == (verdict, label)


@pytest.mark.closed_loop
def test_a_stop_late_in_a_scene_or_behind_what_moves_on_is_a_stop():
    late = judge(drive(np.concatenate([np.full(500, 15.0), np.linspace(15.0, 0.0, 200)])), scene(BOX))
    assert (late.label, late.progress.passed) == ("stopped though passable", (0,))
    leader = Obstacle(50.0, -2.0, 4.5, 1.8, speed=0.5)
    behind = judge(drive(np.linspace(15.0, 0.0, 500)), scene(leader))
    assert (behind.label, behind.progress.followed) == ("stopped though passable", 0)


@pytest.mark.closed_loop
def test_to_follow_is_a_pass_only_close_behind_what_moves_on():
    behind = drive(np.concatenate([np.linspace(15.0, 4.0, 150), np.full(651, 4.0)]), beside=0.0)
    far = Obstacle(40.0, 0.0, 4.5, 1.8, speed=4.0)
    judged = judge(behind, scene(far))
    assert (judged.verdict, judged.label, judged.progress.followed) == (Verdict.PASS, "ok, following", 0)
    gone = Obstacle(75.0, 0.0, 4.5, 1.8, speed=4.0)
    judged = judge(behind, scene(gone))
    assert (judged.verdict, judged.label) == (Verdict.FAIL, "slow though passable")


@pytest.mark.parametrize(
    ("told", "driven", "held"),
    [
        (15.0, 15.0, True),
        (15.0, 13.0, True),
        (15.0, 11.0, False),
        (15.0, 20.0, False),
        (3.0, 0.87, False),
        (3.0, 2.6, True),
        (2.0, 2.7, False),
        (2.0, 2.45, True),
    ],
)
def test_the_speed_held_is_compared_with_the_speed_told(told, driven, held):
    asked = scene(speed=told, start=replace(SCENE.start, v_x=told))
    judged = judge(drive(np.full(801, driven), told=told), asked)
    assert (judged.label != "speed not held") is held
    assert judged.progress.held_speed == pytest.approx(driven)
    assert judged.progress.commanded_speed == pytest.approx(told)


def test_what_only_the_full_speed_comes_to_is_not_due():
    """Avoidance takes a little: what lies beyond nine tenths of the asked way is out of reach, not left out."""
    way = asked_drive(SCENE, 0.0)[1][-1]
    for station, due in ((0.88 * way, True), (0.95 * way, False)):
        went = progress(drive(STEADY[:200]), scene(Obstacle(station + CAR.front_extent + 0.5, 0.0, 1.0, 1.8)))
        assert (went.unpassed, went.out_of_reach) == (((0,), ()) if due else ((), (0,)))


def test_the_speed_control_on_paper_begins_with_the_first_sample():
    """A plant that jumps to its speed: a car like this would not have settled yet."""
    speeds = np.full(230, 15.0)
    assert progress(drive(speeds, told=15.0), SCENE).held_speed == pytest.approx(15.0)
    speeds[0] = 0.0
    assert progress(drive(speeds, told=15.0), SCENE).held_speed is None


def test_a_speed_is_not_compared_before_it_could_be_reached():
    """From 5 m/s on, with the car's own acceleration, and too short a time for it to settle."""
    went = progress(drive(np.full(250, 5.0), told=15.0), SCENE)
    assert went.held_speed is None
