import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import Arc, Line, ReferencePath
from sidestep.validation.geometry import boxes, car_boxes, edge_clearance, obstacle_boxes, signed_clearance
from sidestep.validation.judge.findings import Finding, Verdict
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.recording import SAMPLE_UNITS, STEP_UNITS, End, Recording
from sidestep.validation.loop.start import Departure
from sidestep.validation.scenarios.scenario import load_scenario

SCENE = load_scenario("single-obstacle")
CAR = SCENE.vehicle

coordinate = st.floats(-6.0, 6.0)
angle = st.floats(-math.pi, math.pi)
size = st.floats(0.2, 5.0)
box = st.tuples(coordinate, coordinate, angle, size, size)


def made(x, y, heading, length, width):
    return boxes(*(np.array([v]) for v in (x, y, heading)), length / 2.0, length / 2.0, width)


def clearance(first, second):
    return float(signed_clearance(first, second)[0])


# Signed clearance


def test_boxes_beside_and_behind_each_other():
    first = made(0.0, 0.0, 0.0, 4.0, 2.0)
    assert clearance(first, made(0.0, 3.0, 0.0, 4.0, 2.0)) == pytest.approx(1.0)
    assert clearance(first, made(6.5, 0.0, 0.0, 4.0, 2.0)) == pytest.approx(2.5)
    assert clearance(first, made(7.0, 6.0, 0.0, 4.0, 2.0)) == pytest.approx(5.0)  # corner to corner: 3, 4, 5
    assert clearance(first, made(0.0, 4.0, math.pi / 4.0, 2.0, 2.0)) == pytest.approx(3.0 - math.sqrt(2.0))


def test_the_depth_of_an_overlap_is_the_shortest_way_out():
    first = made(0.0, 0.0, 0.0, 4.0, 2.0)
    assert clearance(first, made(0.0, 1.7, 0.0, 4.0, 2.0)) == pytest.approx(-0.3)
    assert clearance(first, made(3.9, 0.0, 0.0, 4.0, 2.0)) == pytest.approx(-0.1)
    assert clearance(first, first) == pytest.approx(-2.0)
    assert clearance(first, made(0.0, 0.0, 0.0, 1.0, 1.0)) == pytest.approx(-1.5)  # one within the other


@settings(deadline=None)
@given(box, box)
def test_clearance_is_symmetric(a, b):
    first, second = made(*a), made(*b)
    assert clearance(first, second) == pytest.approx(clearance(second, first), abs=1e-12)


@settings(deadline=None)
@given(box, box, coordinate, coordinate, angle)
def test_clearance_does_not_change_when_all_moves_together(a, b, dx, dy, turn):
    def moved(x, y, heading, length, width):
        c, s = math.cos(turn), math.sin(turn)
        return made(dx + c * x - s * y, dy + s * x + c * y, heading + turn, length, width)

    assert clearance(moved(*a), moved(*b)) == pytest.approx(clearance(made(*a), made(*b)), abs=1e-9)


@settings(deadline=None)
@given(box, box, coordinate, coordinate)
def test_a_shift_changes_it_by_its_length_at_most(a, b, dx, dy):
    before = clearance(made(*a), made(*b))
    after = clearance(made(a[0] + dx, a[1] + dy, *a[2:]), made(*b))
    assert abs(after - before) <= math.hypot(dx, dy) + 1e-9


@settings(deadline=None)
@given(box, box)
def test_against_points_sampled_on_the_outlines(a, b):
    """Brute force: for boxes apart, the distance of densely sampled outlines; overlapping ones share a point."""
    first, second = made(*a), made(*b)
    t = np.linspace(0.0, 1.0, 60)[:, None]
    outlines = [
        np.concatenate([q[0, i] + t * (q[0, (i + 1) % 4] - q[0, i]) for i in range(4)]) for q in (first, second)
    ]
    sampled = float(np.linalg.norm(outlines[0][:, None] - outlines[1][None], axis=2).min())
    found = clearance(first, second)
    if found > 0.0:
        assert found - 1e-12 <= sampled <= found + 0.2
    else:
        # separating-axis test: the projections on all edge normals overlap, by the depth at least
        for q in (first, second):
            for i in (0, 1):
                edge = q[0, i + 1] - q[0, i]
                normal = np.array([-edge[1], edge[0]]) / np.linalg.norm(edge)
                p1, p2 = first[0] @ normal, second[0] @ normal
                assert min(p1.max() - p2.min(), p2.max() - p1.min()) >= -found - 1e-9


# Boxes in the world


def test_the_car_reaches_from_its_centre_of_gravity_to_the_bumpers():
    corners = car_boxes(CAR, 10.0, 5.0, math.pi / 2.0)[0]
    assert corners[:, 1].max() == pytest.approx(5.0 + CAR.front_extent)
    assert corners[:, 1].min() == pytest.approx(5.0 - CAR.rear_extent)
    assert np.ptp(corners[:, 0]) == pytest.approx(CAR.width)
    assert corners[0] == pytest.approx([10.0 - CAR.width / 2.0, 5.0 + CAR.front_extent])  # front left


def test_a_moving_obstacle_follows_the_road():
    path = ReferencePath.from_segments([Line(10.0), Arc(100.0, 0.02)])
    moving = Obstacle(5.0, 1.0, 4.0, 2.0, speed=10.0)
    corners = obstacle_boxes(path, moving, np.array([0.0, 2.0]))
    x, y = path.to_cartesian(25.0, 1.0)
    assert corners[1].mean(axis=0) == pytest.approx([x, y])
    along = corners[1, 0] - corners[1, 1]
    assert math.atan2(along[1], along[0]) == pytest.approx(path.heading(25.0))
    assert corners[0].mean(axis=0) == pytest.approx([5.0, 1.0])


@settings(deadline=None)
@given(st.floats(5.0, 100.0), st.floats(-2.0, 2.0), st.floats(-0.5, 0.5))
def test_distance_to_the_edges_on_a_straight_road(s, offset, heading):
    path = ReferencePath.from_segments([Line(150.0)])
    corners = car_boxes(CAR, s, offset, heading)
    expected = min(4.0 - corners[0, :, 1].max(), 3.0 + corners[0, :, 1].min())
    assert edge_clearance(path, 4.0, 3.0, corners, np.array([s]))[0] == pytest.approx(expected)


# The verdict


def recording(x, y, yaw=0.0, end=End.COMPLETED, infeasible=0, contact=False):
    x, y, yaw = np.broadcast_arrays(
        np.asarray(x, dtype=float), np.asarray(y, dtype=float), np.asarray(yaw, dtype=float)
    )
    samples = {name: np.zeros(len(x)) for name in SAMPLE_UNITS}
    speed = np.gradient(x, 0.01) if len(x) > 1 else np.zeros(1)
    samples |= {"time": np.arange(len(x)) * 0.01, "x": x, "y": y, "yaw": yaw, "s": x, "l": y}
    samples |= {"v_x": speed, "target_speed": speed}
    steps = {name: np.ones(3) for name in STEP_UNITS}
    steps["feasible"][:infeasible] = 0.0
    return Recording(samples, steps, end=end, contact=contact)


ROAD_LENGTH = np.linspace(0.0, 100.0, 1001)


def test_a_pass_beside_the_obstacle_is_measured_where_it_is_closest():
    judged = judge(recording(ROAD_LENGTH, 2.2), SCENE)
    assert judged.label == "ok"
    assert judged.passed
    assert judged.min_clearance == pytest.approx(2.2 - CAR.width / 2.0 - 0.9)
    assert judged.obstacle == 0
    assert 40.0 - 2.25 - CAR.front_extent <= judged.s <= 40.0 + 2.25 + CAR.rear_extent
    assert judged.time == pytest.approx(judged.s / 10.0, abs=1e-9)
    assert judged.min_edge_clearance == pytest.approx(4.0 - 2.2 - CAR.width / 2.0)


def test_driving_through_the_obstacle_is_a_collision():
    judged = judge(recording(ROAD_LENGTH, 0.3), SCENE)
    assert (judged.label, judged.passed) == ("collision", False)
    assert judged.min_clearance == pytest.approx(-(0.9 + CAR.width / 2.0 - 0.3))


def test_the_plants_own_contact_is_a_collision_too():
    assert judge(recording(ROAD_LENGTH, 2.2, contact=True), SCENE).label == "collision"


def test_a_moving_obstacle_is_met_where_it_is_then():
    oncoming = replace(SCENE, obstacles=(Obstacle(100.0, 0.0, 4.5, 1.8, speed=-10.0),))
    halted = recording(np.full(600, 50.0), 0.0)
    judged = judge(halted, oncoming)
    assert judged.label == "collision"
    first_touch = (100.0 - 2.25 - 50.0 - CAR.front_extent) / 10.0
    early = judge(recording(np.full(int(first_touch * 100.0), 50.0), 0.0), oncoming)
    assert not early.touched
    assert 0.0 < early.min_clearance < 0.3


def test_leaving_the_road_on_either_side():
    empty = replace(SCENE, obstacles=())
    edge = 4.0 - CAR.width / 2.0
    for side in (1.0, -1.0):
        assert judge(recording(ROAD_LENGTH, side * (edge - 0.01)), empty).label == "ok"
        judged = judge(recording(ROAD_LENGTH, side * (edge + 0.01)), empty)
        assert (judged.label, judged.passed) == ("corridor violation", False)
        assert judged.min_edge_clearance == pytest.approx(-0.01)
        assert judged.min_clearance is None


@pytest.mark.parametrize(
    ("keywords", "label", "passed"),
    [
        ({"end": End.END_OF_ROAD}, "ok", True),
        ({"infeasible": 2}, "infeasible, handled", True),
        ({"end": End.PLANT_INVALID}, "plant invalid", False),
        ({"end": End.CONTROLLER_ERROR}, "controller error", False),
        ({"end": End.BUS_ERROR}, "bus error", False),
        ({"end": End.PLANT_INVALID, "contact": True}, "plant invalid", False),
        ({"end": End.INTERRUPTED, "contact": True}, "collision", False),
    ],
)
def test_labels(keywords, label, passed):
    judged = judge(recording(ROAD_LENGTH, 2.2, **keywords), SCENE)
    assert (judged.label, judged.passed) == (label, passed)
    assert judged.verdict is (Verdict.PASS if passed else Verdict.FAIL)
    assert judged.touched is not passed


def test_an_interrupted_run_shows_nothing():
    judged = judge(recording(ROAD_LENGTH, 2.2, end=End.INTERRUPTED), SCENE)
    assert (judged.label, judged.verdict, judged.touched) == ("interrupted", Verdict.INCONCLUSIVE, False)


@pytest.mark.parametrize("depth", [1e-6, 1e-3, 0.05, 0.3])
def test_no_overlap_is_small_enough_to_pass(depth):
    """Of the outlines, and over the road's edge; as far on the other side of nothing, both pass."""
    beside = CAR.width / 2.0 + 0.9
    edge = 4.0 - CAR.width / 2.0
    empty = replace(SCENE, obstacles=())
    assert judge(recording(ROAD_LENGTH, beside - depth), SCENE).label == "collision"
    assert judge(recording(ROAD_LENGTH, edge + depth), empty).label == "corridor violation"
    assert judge(recording(ROAD_LENGTH, beside + depth), SCENE).passed
    assert judge(recording(ROAD_LENGTH, edge - depth), empty).passed


GRAVE = Finding("controller silent", Verdict.FAIL, "no command from 3.2 s on")
DOUBTFUL = Finding("log cut short", Verdict.INCONCLUSIVE, "the bus was not seen from 5 s on")
HARMLESS = Finding("late once", Verdict.PASS, "one command 12 ms late")


@pytest.mark.parametrize(
    ("findings", "verdict", "label"),
    [
        ((), Verdict.PASS, "ok"),
        ((HARMLESS,), Verdict.PASS, "ok"),
        ((HARMLESS, GRAVE, DOUBTFUL), Verdict.FAIL, "controller silent"),
        ((DOUBTFUL, GRAVE), Verdict.INCONCLUSIVE, "log cut short"),
    ],
)
def test_what_others_saw_decides_a_drive_without_an_incident(findings, verdict, label):
    judged = judge(recording(ROAD_LENGTH, 2.2), SCENE, findings)
    assert (judged.verdict, judged.label, judged.findings) == (verdict, label, findings)
    assert judge(recording(ROAD_LENGTH, 0.3), SCENE, findings).label == "collision"


def test_a_start_that_was_accepted_is_told_by_the_label():
    off = (Departure("v_x", 15.0, 10.0),)
    assert judge(replace(recording(ROAD_LENGTH, 2.2), departures=off), SCENE).label == "ok, start not as asked"
    assert judge(replace(recording(ROAD_LENGTH, 0.3), departures=off), SCENE).label == "collision"
