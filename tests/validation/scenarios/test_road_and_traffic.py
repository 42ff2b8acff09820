import math

import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import Obstacle
from sidestep.validation.geometry import FAR, obstacle_boxes, obstacle_poses
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.loop.closed_loop import SeesPresent, open_controller
from sidestep.validation.loop.recording import End
from sidestep.validation.scenarios.scenario import parse_scenario

STRAIGHT = """
speed = 10.0
duration = 4.0
plant = { kind = "linear" }
road = { width_left = 4.0, width_right = 4.0, segments = [{ type = "line", length = 100.0 }] }
"""
KINKED = """
speed = 10.0
duration = 2.0
plant = { kind = "linear" }
[road]
width_left = 4.0
width_right = 4.0
points = [[0, 0], [30, 0], [60, 9], [90, 9], [130, 9]]
"""


def scene(text, *overrides):
    return parse_scenario(text, "test", overrides)


# The road


def test_places_count_along_the_way_points_as_they_were_given():
    scenario = scene(KINKED, "start.s=40", "start.l=0.3", "obstacles=[{s=75, l=1, length=4, width=2, heading=0.1}]")
    chord = math.atan2(9.0, 30.0)
    x, y = 30.0 + 10.0 * math.cos(chord) - 0.3 * math.sin(chord), 10.0 * math.sin(chord) + 0.3 * math.cos(chord)
    assert (scenario.start.x, scenario.start.y) == pytest.approx((x, y), abs=1e-9)
    place = obstacle_poses(scenario.path, scenario.obstacles[0], np.zeros(1))[:, 0]
    s = 75.0 - 30.0 - math.hypot(30.0, 9.0)
    assert place[:2] == pytest.approx((60.0 + s, 10.0), abs=1e-9)
    assert place[2] == pytest.approx(0.1 + chord * 0.5 * (1.0 - s / 30.0), abs=1e-9)  # half-way between the chords


def test_a_road_is_closed_by_its_key():
    angle = np.linspace(0.0, math.tau, 60, endpoint=False)
    points = (40.0 * np.column_stack([np.cos(angle), np.sin(angle)])).tolist()
    assert scene(KINKED, f"road.points={points}").path.closed
    assert not scene(KINKED, f"road.points={points}", "road.closed=false").path.closed


def test_widths_come_from_the_points_or_from_the_keys_but_not_half():
    wide = KINKED.replace(
        "[[0, 0], [30, 0], [60, 9], [90, 9], [130, 9]]", "[[0, 0, 3, 2], [50, 0, 5, 2], [99, 0, 3, 2]]"
    )
    bare = wide.replace("width_left = 4.0\n", "").replace("width_right = 4.0\n", "")
    scenario = scene(bare)
    assert scenario.path.widths(25.0)[0] == pytest.approx(4.0)
    assert (scenario.controller.width_left, scenario.controller.width_right) == (3.0, 2.0)  # the narrowest
    assert scene(wide).path.widths(25.0)[0] == pytest.approx(4.0)
    assert scene(wide, "road.width_left=1.5").path.widths(99.0)[0] == pytest.approx(1.5)
    with pytest.raises(InputError, match="one width is given here"):
        scene(bare, "road.width_left=1.5")
    with pytest.raises(InputError, match=r"road\.width_left: missing"):
        scene(KINKED.replace("width_left = 4.0\n", ""))


def test_notes_tell_what_was_put_right():
    far = scene(KINKED, "road.points=[[500000, 4e6], [500000, 4e6], [500050, 4000001]]")
    assert far.path.origin == (500000.0, 4000000.0)
    assert any("merged 1 way-points" in note for note in far.notes)
    assert any("counted from (500000, 4000000)" in note for note in far.notes)
    assert abs(far.start.x) < 1.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("road.smooth=0.5", "road.smooth: is for way-points"),
        ("road.points=[[0,0],[1,1]]", "needs either segments or waypoints"),
        ("goal={}", "goal: empty"),
        ("goal={s=[5]}", "goal.s: [5.0]; allowed: [from, to]"),
        ("obstacles=[{l=1, length=1, width=1}]", "obstacles[0].s: missing"),
        ("obstacles=[{s=9, length=1, width=1, trajectory={t=[0], s=[9], l=[0]}}]", "obstacles[0].s: is given together"),
        (
            "obstacles=[{length=1, width=1, trajectory={t=[0, 1], s=[9], l=[0, 0]}}]",
            "trajectory.s: 1 values; allowed: 2",
        ),
        ("obstacles=[{length=1, width=1, trajectory={t=[1, 0], s=[9, 9], l=[0, 0]}}]", "does not ascend"),
        ("obstacles=[{length=1, width=1, trajectory={frame='wrld'}}]", "allowed: road, world"),
        ("obstacles=[{length=1, width=1, trajectory={file='none.csv'}}]", "trajectory.file: no file"),
    ],
)
def test_what_cannot_be_is_named(change, words):
    with pytest.raises(InputError) as caught:
        scene(STRAIGHT, change)
    assert words in str(caught.value)


# Traffic


def test_a_trajectory_from_a_file_in_the_world(tmp_path):
    (tmp_path / "walker.csv").write_text("t [s],x,y,heading,v\n0,50,-5,1.57,1\n4,50,5,1.57,1\n")
    text = (
        STRAIGHT + '[[obstacles]]\nlength = 0.5\nwidth = 0.5\ntrajectory = { frame = "world", file = "walker.csv" }\n'
    )
    scenario = parse_scenario(text, "test", file=tmp_path / "scene.toml")
    poses = obstacle_poses(scenario.path, scenario.obstacles[0], np.array([0.0, 2.0, 9.0]))
    np.testing.assert_allclose(poses.T, [[50.0, -5.0, 1.57], [50.0, 0.0, 1.57], [50.0, 5.0, 1.57]], atol=1e-9)


def test_heading_follows_the_motion_unless_it_is_given():
    scenario = scene(
        STRAIGHT, "obstacles=[{length=2, width=1, trajectory={frame='world', t=[0,1,2], x=[50,50,52], y=[0,2,2]}}]"
    )
    assert obstacle_poses(scenario.path, scenario.obstacles[0], np.zeros(1))[2] == pytest.approx(math.pi / 2.0)


def test_what_is_not_there_is_far_away():
    box = Obstacle(50.0, 0.0, 2.0, 2.0, appears=1.0, vanishes=2.0)
    corners = obstacle_boxes(scene(STRAIGHT).path, box, np.array([0.0, 1.5, 2.5]))
    assert corners[1].mean(axis=0) == pytest.approx((50.0, 0.0))
    assert np.all(corners[[0, 2]] > FAR / 2.0)


@pytest.mark.closed_loop
def test_the_judge_sees_a_walker_who_comes_and_goes():
    walker = "{length=0.6, width=0.6, trajectory={t=[0, 1.5, 3], s=[22, 22, 22], l=[-6, 0, 6]}}"
    recording, judgement = simulate(scene(STRAIGHT, f"obstacles=[{walker}]"))
    times, x, y = (recording[name] for name in ("time", "x", "y"))
    feet = np.hypot(x - 22.0, y - np.interp(times, [0.0, 1.5, 3.0], [-6.0, 0.0, 6.0]))
    assert judgement.min_clearance == pytest.approx(feet.min(), abs=2.5)
    assert judgement.min_clearance < feet.min()
    later = f"obstacles=[{walker[:-1]}, appears=3.9}}]"
    assert simulate(scene(STRAIGHT, later))[1].min_clearance > 5.0


@pytest.mark.closed_loop
def test_the_controller_sees_where_a_box_is_now():
    scenario = scene(STRAIGHT, "obstacles=[{length=4, width=2, trajectory={t=[0, 2, 4], s=[30, 50, 50], l=[0, 0, 2]}}]")
    controller = open_controller(scenario)
    assert isinstance(controller, SeesPresent)
    controller.step(scenario.start)
    assert controller.boxes[0, [0, 1, 5]] == pytest.approx([30.0, 0.0, 10.0])
    assert type(open_controller(scene(STRAIGHT))).__name__ == "SteeringController"


# Start and goal


def test_the_start_may_slide_turn_and_stand():
    start = scene(STRAIGHT, "start={speed=8, sideslip=0.1, yaw_rate=0.3}").start
    assert (start.v_x, start.v_y, start.yaw_rate) == pytest.approx((8.0 * math.cos(0.1), 8.0 * math.sin(0.1), 0.3))
    assert scene(STRAIGHT, "start.speed=0").start.v_x == 0.0


@pytest.mark.closed_loop
def test_a_goal_ends_the_drive():
    recording, judgement = simulate(scene(STRAIGHT, "goal={s=[20, 30], l=[-1, 1], speed=[5, 15]}"))
    assert recording.end is End.GOAL
    assert recording["s"][-1] == pytest.approx(20.0, abs=0.2)
    assert judgement.passed
    assert simulate(scene(STRAIGHT, "goal={s=[20, 30], speed=[0, 5]}"))[0].end is End.COMPLETED


@pytest.mark.closed_loop
def test_progress_counts_where_a_box_is_by_then():
    box = "{length=4, width=2, trajectory={t=[0, 1, 9], s=[30, 30, 30], l=[0, 3, 3]}}"
    waits = simulate(scene(STRAIGHT, f"obstacles=[{box}]"))[1]
    flees = simulate(scene(STRAIGHT, f"obstacles=[{box.replace('30, 30, 30', '30, 45, 300')}]"))[1]
    assert waits.progress.reached == (0,)
    assert flees.progress.reached == ()
