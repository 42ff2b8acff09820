"""The label of a scene: hand-made scenes whose answer is known, and witnesses measured by other code."""

import math

import numpy as np
import pytest

from sidestep.plant_models.vehicle.parameters import GRAVITY
from sidestep.validation.geometry import car_boxes, edge_clearance, obstacle_boxes, signed_clearance
from sidestep.validation.judge.feasibility import (
    LATERAL_SHARE,
    MARGIN,
    REACTION_TIME,
    STEER_SHARE,
    Feasibility,
    assess,
    way_past,
)
from sidestep.validation.judge.reachability import MAX_JERK
from sidestep.validation.scenarios.random_scenes import random_scene
from sidestep.validation.scenarios.scenario import Scenario, parse_scenario

WIDTH, FRONT = 1.61, 2.1207
"""Of the preset's car, in [m]."""


def scene(*boxes: str, speed: float = 15.0) -> Scenario:
    head = f"speed = {speed}\nduration = 20.0\n[road]\nwidth_left = 4.0\nwidth_right = 4.0\n"
    road = 'segments = [{ type = "line", length = 300.0 }]\n'
    return parse_scenario(head + road + "".join(f"[[obstacles]]\n{box}\n" for box in boxes), "scene")


def box(s: float, right: float, left: float, length: float = 1.0, speed: float = 0.0) -> str:
    middle, width = 0.5 * (right + left), left - right
    return f"s = {s}\nl = {middle}\nlength = {length}\nwidth = {width}\nspeed = {speed}"


def gate(s: float, middle: float, width: float) -> tuple[str, str]:
    return box(s, -4.0, middle - 0.5 * width), box(s, middle + 0.5 * width, 4.0)


def verdict(scenario: Scenario) -> tuple[bool, bool]:
    found = assess(scenario)
    return found.passable, found.stoppable


def test_a_free_road_is_passable_and_the_car_can_stop():
    assert verdict(scene()) == (True, True)


@pytest.mark.closed_loop
def test_a_wall_is_not_passable():
    stop = FRONT + REACTION_TIME * 15.0 + 15.0**2 / (2.0 * 0.8 * 8.0) + MARGIN + 0.5  # bumper, reaction, braking
    assert verdict(scene(box(stop + 0.5, -4.0, 4.0))) == (False, True)


@pytest.mark.closed_loop
def test_a_wall_closer_than_the_stop_is_hit():
    stop = FRONT + REACTION_TIME * 15.0 + 15.0**2 / (2.0 * 0.8 * 8.0) + MARGIN + 0.5
    assert verdict(scene(box(stop - 0.5, -4.0, 4.0))) == (False, False)


@pytest.mark.closed_loop
@pytest.mark.parametrize("middle", [0.0, 1.5])
def test_a_gap_is_passable_if_the_car_and_both_margins_fit(middle):
    needed = WIDTH + 2.0 * MARGIN
    assert assess(scene(*gate(60.0, middle, needed + 0.15))).passable
    assert not assess(scene(*gate(60.0, middle, needed - 0.02))).passable


@pytest.mark.closed_loop
def test_an_s_gap_needs_length_for_its_speed():
    gates = (*gate(50.0, -1.5, 2.6), *gate(60.0, 1.5, 2.6))
    assert assess(scene(*gates, speed=6.0)).passable
    assert not assess(scene(*gates, speed=25.0)).passable


def test_what_appears_within_the_reaction_distance_cannot_be_avoided():
    assert verdict(scene(box(FRONT + 7.0, -2.5, 2.5), speed=20.0)) == (False, False)


@pytest.mark.closed_loop
def test_a_slow_car_ahead_is_overtaken_unless_one_comes_towards():
    slow = box(30.0, -1.0, 1.0, length=4.5, speed=5.0)
    assert assess(scene(slow)).passable
    both_lanes = [box(30.0, -4.0, 0.5, length=4.5, speed=5.0), box(80.0, 1.0, 4.0, length=4.5, speed=-10.0)]
    assert verdict(scene(*both_lanes)) == (False, True)


@pytest.mark.closed_loop
def test_the_standing_car_is_out_of_the_way_of_what_still_comes():
    found = assess(scene(box(70.0, -4.0, 4.0), box(120.0, -1.0, 4.0, speed=-6.0)))
    assert (found.passable, found.stoppable) == (False, True)
    assert found.witness[-1, 2] + WIDTH / 2.0 < -1.0


@pytest.mark.closed_loop
@pytest.mark.parametrize("seed", [1, 3, 5, 10, 145, 237])
def test_a_way_through_is_a_drivable_way_through(seed):
    scenario = parse_scenario(random_scene(seed), "scene")
    found = assess(scenario)
    assert found.passable
    time, s, _, _, curvature, speed = found.witness.T
    x, y, yaw = poses(scenario, found)
    assert speed == pytest.approx(scenario.speed)
    assert np.hypot(np.diff(x), np.diff(y)) == pytest.approx(scenario.speed * np.diff(time), rel=3e-3)
    assert np.diff(yaw) == pytest.approx(0.5 * (curvature[1:] + curvature[:-1]) * speed[1:] * np.diff(time), abs=2e-4)
    assert np.abs(speed**2 * curvature).max() <= LATERAL_SHARE * GRAVITY * (1.0 + 1e-6)
    rate = np.abs(np.diff(curvature) / np.diff(time)).max()
    assert rate <= STEER_SHARE * scenario.vehicle.steer_rate_limit / scenario.vehicle.wheelbase + 1e-9
    assert rate * scenario.speed**2 <= MAX_JERK + 1e-6
    assert clearance(scenario, found) >= MARGIN - 0.01
    assert all(s[-1] - scenario.vehicle.rear_extent > o.s + o.speed * time[-1] for o in scenario.obstacles)


@pytest.mark.closed_loop
@pytest.mark.parametrize("seed", [0, 8, 9])
def test_a_stop_is_a_stop_and_stays_free(seed):
    scenario = parse_scenario(random_scene(seed), "scene")
    found = assess(scenario)
    assert (found.passable, found.stoppable) == (False, True)
    speed = found.witness[:, 5]
    assert speed[0] == pytest.approx(scenario.speed)
    assert speed[-1] == 0.0
    deceleration = np.diff(speed) / np.diff(found.witness[:, 0])
    assert deceleration.min() >= -0.8 * scenario.vehicle.max_braking - 1e-9
    assert clearance(scenario, found) >= MARGIN - 0.01


def poses(scenario: Scenario, found: Feasibility) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    s, offset, heading = found.witness[:, 1].copy(), found.witness[:, 2].copy(), found.witness[:, 3]
    x, y = scenario.path.to_cartesian(s, offset)
    return x, y, scenario.path.heading(s) + heading


def clearance(scenario: Scenario, found: Feasibility) -> float:
    """To the nearest obstacle or edge along the witness, by the judge's geometry."""
    car = car_boxes(scenario.vehicle, *poses(scenario, found))
    config, time = scenario.controller, found.witness[:, 0]
    edge = edge_clearance(scenario.path, config.width_left, config.width_right, car, found.witness[:, 1]).min()
    gaps = [signed_clearance(car, obstacle_boxes(scenario.path, o, time)).min() for o in scenario.obstacles]
    return min(float(edge), *map(float, gaps), math.inf)


BEND = """
speed = 20.0
duration = 14.0
[road]
width_left = 4.0
width_right = 4.0
segments = [
    { type = "line", length = 80.0 }, { type = "clothoid", length = 20.0, curvature_start = 0.0, curvature_end = 0.05 },
    { type = "arc", length = 40.0, curvature = 0.05 }, { type = "line", length = 40.0 },
]
"""


@pytest.mark.closed_loop
def test_a_way_past_leads_through_the_bends_of_the_whole_scene():
    """20 m/s into a bend of 20 m radius is no way past, 10 m/s is; with half of the grip, believed or true, 5 m/s."""
    shares = [
        found.share if (found := way_past(parse_scenario(BEND, "bend", changes), 0.2)) else None
        for changes in ([], ["plant.friction=0.6"], ["controller.friction=0.6"])
    ]
    assert shares == [0.5, 0.25, 0.25]
