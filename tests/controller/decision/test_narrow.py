"""The slow way through what stands close: its outline, its curvature, its speed, and drives that need it."""

import math

import numba
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.controller.config import ControllerConfig
from sidestep.controller.decision.corridor import obstacle_polygons
from sidestep.controller.decision.moves import CREEP
from sidestep.controller.decision.narrow import ROUNDED_LAYERS, allowed_speeds, is_narrow, plan_narrow
from sidestep.controller.decision.planner import PlannerSettings
from sidestep.controller.decision.view import View
from sidestep.controller.records import PLANNER, filled
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.loop.recording import End
from sidestep.validation.scenarios.scenario import parse_scenario

BMW = VehicleParameters.preset("bmw-320i")
CONFIG = ControllerConfig(width_left=9.0, width_right=5.4)
P = filled(PLANNER, PlannerSettings.of(BMW, CONFIG)._asdict())[0]
NOWHERE = np.zeros(0), np.zeros(0)
START = (0.0, 0.0, 0.0)


def seen(boxes, committed=None):
    rows = np.array([(*box, 0.0) for box in boxes]).reshape(-1, 6)
    sides = np.zeros(len(rows), np.int64) if committed is None else np.array(committed)
    outlines = obstacle_polygons(rows, np.zeros(len(rows)))
    return View(outlines, np.zeros(len(rows)), sides, np.full(len(rows), np.inf))


def car_at(s, l, slope):  # noqa: E741
    corners = [(a, b) for a in (BMW.front_extent, -BMW.rear_extent) for b in (0.5 * BMW.width, -0.5 * BMW.width)]
    hull = shapely.MultiPoint(corners).convex_hull
    turned = shapely.affinity.rotate(hull, math.atan(slope), origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, s, l)


def boxes_of(seed):
    rng = np.random.default_rng(seed)
    lanes = [(lane, s) for lane in (-3.6, 0.0, 3.6, 7.2) for s in rng.uniform(16.0, 80.0, 2)]
    return [(s, lane + rng.normal(0.0, 0.3), 4.8, 1.9, rng.normal(0.0, 0.04)) for lane, s in lanes]


@settings(max_examples=2 if numba.config.DISABLE_JIT else 40, deadline=None)  # plain Python takes seconds for one
@given(st.integers(0, 10_000), st.floats(2.0, 14.0))
def test_the_outline_as_driven_keeps_what_is_asked_and_the_curvature_what_the_car_can(seed, speed):
    boxes = boxes_of(seed)
    way = plan_narrow(START, speed, NOWHERE, seen(boxes), P)
    if not way.found:
        return
    spacing = np.diff(way.stations)[1:]
    turns = np.abs(np.diff(way.slopes[1:]))
    assert turns.max() / spacing.min() <= P["most_curvature"]
    assert turns.max() <= 0.1 + 1e-9  # one step a layer
    walls = [shapely.Polygon(outline) for outline in seen(boxes).polygons]
    for i in range(1, len(way.stations)):
        for part in (0.0, 0.5, 1.0):
            s = way.stations[i - 1] + part * (way.stations[i] - way.stations[i - 1])
            car = car_at(s, way.offsets[i] + way.slopes[i] * (s - way.stations[i]), way.slopes[i])
            room = min(wall.distance(car) for wall in walls)
            if i > ROUNDED_LAYERS:  # half a step of the grid less, and across the road, not square to the wall
                assert room >= 0.9 * (P["least_clearance"] - 0.04)
    assert way.offsets.min() - 0.5 * BMW.width >= P["right_edge"]
    assert way.offsets.max() + 0.5 * BMW.width <= P["left_edge"]


def test_there_is_none_through_a_wall():
    assert not plan_narrow(START, 5.0, NOWHERE, seen([(40.0, 1.8, 2.0, 14.0, 0.0)]), P).found


def test_what_was_best_stays_best_while_the_car_follows_it():
    boxes = boxes_of(1)
    first = plan_narrow(START, 6.0, NOWHERE, seen(boxes), P)
    assert first.found
    step = 3
    s, l = first.stations[step], first.offsets[step]  # noqa: E741
    later = [(box[0] - s, *box[1:]) for box in boxes]
    pose = (s, l + 0.05, first.slopes[step + 1] + 0.03)  # nearly on it
    again = plan_narrow(pose, 6.0, (first.stations, first.offsets), seen(later), P)
    assert again.offsets[1:40] == pytest.approx(first.offsets[step + 1 : step + 40], abs=1e-9)


def test_speed_falls_with_room_and_bends():
    free = plan_narrow(START, 10.0, NOWHERE, seen([]), P)
    assert allowed_speeds(free, 4.0, P).min() > 30.0
    assert not is_narrow(free, P)
    gate = [(30.0, 1.8, 4.5, 2.0, 0.0), (30.0, -1.1, 4.5, 0.2, 0.0)]  # 1.81 m between them and a car of 1.61 m
    walls = [(30.0, 6.5, 4.5, 5.0, 0.0), (30.0, -4.0, 4.5, 4.0, 0.0)]
    through = plan_narrow(START, 10.0, NOWHERE, seen([*gate, *walls]), P)
    assert through.found
    assert is_narrow(through, P)
    speeds = allowed_speeds(through, 4.0, P)
    beside = np.abs(through.stations - 30.0) < 3.0
    assert CREEP <= speeds[beside].max() < 6.0
    assert speeds[0] > 10.0


BETWEEN_THREE = """
    name = "between-three"
    speed = 12.19
    duration = 16.0
    road = { width_left = 8.45, width_right = 8.5, segments = [{ type = "line", length = 230.0 }] }
    start = { s = 10.0, l = 0.6 }
    plant.kind = "single-track"
    [[obstacles]]
    s = 30.4
    l = 3.5
    length = 4.5
    width = 2.0
    heading = 0.03
    [[obstacles]]
    s = 38.5
    l = 0.3
    length = 6.0
    width = 2.6
    heading = -0.03
    [[obstacles]]
    s = 34.8
    l = -2.9
    length = 6.1
    width = 2.0
    heading = -0.04
"""


@pytest.mark.closed_loop
@pytest.mark.parametrize("speed", [12.19, 8.0, 5.0])
def test_a_way_between_cars_that_only_a_slow_one_finds_is_driven(speed):
    """The like of a motorway's traffic that stands: at 0.35 rad and with a buffer for a wall it ended in a stop."""
    scenario = parse_scenario(BETWEEN_THREE, "three", [f"speed={speed}", "duration=30"])
    recording, judgement = simulate(scenario)
    assert recording.end is not End.STOPPED
    assert judgement.passed
    assert judgement.min_clearance is not None
    assert judgement.min_clearance > 0.02
