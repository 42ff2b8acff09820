"""The path search against brute force, and what it must do with obstacles in the way."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.controller.decision.corridor import obstacle_polygons
from sidestep.controller.decision.costs import (
    APPROACH_SHARE,
    BLOCKED_COST,
    COLLISION_COST,
    FAR_SHARE,
    RETURN_SHARE,
    RETURN_TIME,
    Lattice,
    node_costs,
)
from sidestep.controller.decision.lattice import LATERAL_STEP, arrival_times, shortest_path
from sidestep.controller.decision.planner import FREE, GAP_TOO_NARROW, PlannedPath, PlannerSettings, Start, plan_path
from sidestep.controller.decision.view import View

SETTINGS = PlannerSettings(
    front=2.12, rear=2.39, reach=1.35, half_width=0.805, buffer=0.2, tightening=0.03, margin_time=0.01,
    safe_distance=1.0, reference=0.0, right_edge=-4.0, left_edge=4.0, weight_reference=1.0, weight_continuity=0.2,
    weight_obstacle=3.0, hysteresis=2.0, max_lateral_speed=5.0, max_slope=0.35, acceleration=3.0,
    braking=8.0, comfort_braking=3.0, least_clearance=0.1, most_curvature=0.15, turning=0.1,
)  # fmt: skip
HARD = SETTINGS.half_width + SETTINGS.buffer


def search(boxes, speed=15.0, offset=0.0, committed=None, station=0.0, settings=SETTINGS) -> PlannedPath:
    boxes = np.array(boxes, dtype=float).reshape(-1, 6)
    polygons = obstacle_polygons(boxes, np.zeros(len(boxes)))
    committed = np.zeros(len(boxes), dtype=np.int64) if committed is None else np.array(committed)
    met_until = np.full(len(boxes), math.inf)
    view = View(polygons, boxes[:, 5].copy(), committed, met_until)
    return plan_path(Start(station, offset, speed, speed), view, settings)


def brute_force(cost, first_weight, weight, reach, start, start_reach):
    layers, lateral = cost.shape
    least = math.inf
    for path in itertools.product(range(lateral), repeat=layers):
        if abs(path[0] - start) > start_reach or any(abs(a - b) > reach for a, b in itertools.pairwise(path)):
            continue
        total = first_weight * (path[0] - start) ** 2 + weight * sum((a - b) ** 2 for a, b in itertools.pairwise(path))
        least = min(least, total + sum(cost[i, j] for i, j in enumerate(path)))
    return least


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.floats(0.0, 4.0))
def test_search_finds_the_optimum_of_brute_force(seed, reach, start):
    rng = np.random.default_rng(seed)
    cost = rng.exponential(1.0, (5, 5)) * np.where(rng.random((5, 5)) < 0.3, 1e4, 1.0)
    path, least = shortest_path(cost, 0.7, 0.3, reach, start, 1.5, 2.0)
    assert least == pytest.approx(brute_force(cost, 0.7, 0.3, reach, start, 1.5), rel=1e-12)
    driven = 0.7 * (path[0] - start) ** 2 + 0.3 * sum((a - b) ** 2 for a, b in itertools.pairwise(path))
    assert driven + cost[np.arange(5), path].sum() == pytest.approx(least, rel=1e-12)
    assert np.abs(np.diff(path)).max() <= reach


def test_unreachable_search_is_infinite_but_returns():
    _, least = shortest_path(np.zeros((3, 4)), 1.0, 1.0, 1, 50.0, 1.0, 0.0)
    assert math.isinf(least)


def test_free_road_is_followed():
    path = search([])
    assert path.blocker == FREE
    assert np.abs(path.offsets).max() == 0.0
    assert path.cost == 0.0
    assert path.left == pytest.approx(np.full(len(path.left), 4.0 - HARD))
    assert path.right == pytest.approx(np.full(len(path.left), -4.0 + HARD))


def test_node_costs_are_those_of_the_paper():
    box = np.array([[20.0, 0.0, 4.0, 2.0, 0.0, 0.0]])
    stations, offsets = np.arange(1.0, 60.0), np.arange(-3.0, 3.01, 0.5)
    speeds, committed = np.zeros(1), np.zeros(1, np.int64)

    def costs(met_until):
        polygons, met_until = obstacle_polygons(box, np.zeros(1)), np.array([met_until])
        nodes, view = Lattice(stations, stations / 15.0, offsets), View(polygons, speeds, committed, met_until)
        return node_costs(nodes, 15.0, view, SETTINGS)

    cost, settled = costs(math.inf)
    assert settled == pytest.approx(22.0 + SETTINGS.rear + 15.0 * RETURN_TIME * math.sqrt(1.0 + HARD))
    assert cost[57] == pytest.approx(offsets**2)  # (10) far from everything
    assert cost[30] == pytest.approx(RETURN_SHARE * offsets**2)
    assert cost[19, 6] > COLLISION_COST
    soft = HARD + SETTINGS.tightening + 0.15
    d = 2.5 - 1.0 - soft  # (12) beside the box: d_obs less what it was expanded by
    assert cost[19, 11] == pytest.approx(APPROACH_SHARE * 2.5**2 + 3.0 * (1.0 - d) ** 2)
    assert cost[19, np.abs(offsets) < 1.0 + HARD - LATERAL_STEP].min() >= BLOCKED_COST
    far, _ = costs(15.0)  # it may stop before
    assert far[19, 6] == pytest.approx(cost[19, 6] - (1.0 - FAR_SHARE) * (BLOCKED_COST + COLLISION_COST))


def test_path_keeps_clear_and_respects_the_slope_limit():
    path = search([(40.0, 0.0, 4.5, 1.8, 0.0, 0.0)])
    assert path.blocker == FREE
    beside = np.abs(path.stations - 40.0) < 2.25
    assert np.abs(path.offsets[beside]).min() >= 0.9 + HARD
    slope = np.diff(path.offsets[1:]) / np.diff(path.stations[1:])
    assert np.abs(slope).max() <= 5.0 / 15.0 + 1e-9
    assert np.all(path.offsets >= path.right - 1e-9)
    assert np.all(path.offsets <= path.left + 1e-9)


def test_mirrored_scene_gives_the_mirrored_path():
    boxes = [(30.0, -0.6, 4.5, 1.8, 0.2, 0.0), (60.0, 0.9, 3.0, 1.0, 0.0, 0.0)]
    mirrored = (np.array(boxes) * [1, -1, 1, 1, -1, 1]).tolist()
    left, right = search(boxes), search(mirrored)
    assert left.offsets == pytest.approx(-right.offsets, abs=1e-9)
    assert left.cost == pytest.approx(right.cost)
    assert list(left.sides) == [-side for side in right.sides]


@pytest.mark.parametrize("side", [-1, 1])
def test_committed_side_is_kept(side):
    box = (40.0, 0.0, 4.5, 1.8, 0.0, 0.0)
    assert search([box], committed=[side]).sides[0] == side


def test_hysteresis_gives_way_to_a_much_better_side():
    assert search([(40.0, -0.9, 4.5, 1.8, 0.0, 0.0)], committed=[-1]).sides[0] == 1


def test_wall_blocks_and_names_itself():
    path = search([(30.0, -3.0, 2.0, 1.0, 0.0, 0.0), (50.0, 0.0, 1.0, 9.0, 0.0, 0.0)])
    assert path.blocker == 1
    assert path.sides[1] == 0


def test_gap_narrower_than_car_and_buffers_blocks_and_a_wider_one_does_not():
    def gap(width):
        half = 0.5 * width
        boxes = [(50.0, s * (half + 3.0), 2.0, 6.0, 0.0, 0.0) for s in (-1, 1)]
        return search(boxes)

    assert gap(2 * HARD - 0.01).blocker == GAP_TOO_NARROW
    assert 40.0 < gap(2 * HARD - 0.01).room < 50.0 - SETTINGS.front
    assert gap(2 * HARD + 0.01).blocker == FREE


def test_road_narrower_than_the_car_blocks_at_once():
    path = search([], settings=SETTINGS._replace(left_edge=0.9, right_edge=-0.9))
    assert path.blocker == GAP_TOO_NARROW
    assert path.room == 0.0


def test_alongside_within_the_buffer_is_not_blocked():
    path = search([(1.0, 1.9, 4.5, 1.8, 0.0, 0.0)], offset=0.1)  # 9 cm beside it
    assert path.blocker == FREE


def test_moving_obstacle_is_met_where_it_will_be():
    oncoming = search([(80.0, 0.0, 4.5, 1.8, 0.0, -15.0)])
    peak = oncoming.stations[np.abs(oncoming.offsets).argmax()]
    assert peak == pytest.approx(40.0, abs=5.0)
    fleeing = search([(10.0, 0.0, 4.5, 1.8, 0.0, 15.0)])
    assert np.abs(fleeing.offsets).max() == 0.0


@pytest.mark.parametrize("offset", [-9.0, 6.0])
def test_start_off_the_road_leads_back(offset):
    path = search([], offset=offset)
    assert np.isfinite(path.cost)
    assert abs(path.offsets[-1]) < abs(offset)
    assert abs(path.offsets[1]) <= 4.0 - HARD


def test_layers_stand_still_while_the_car_moves():
    box = (70.0, 0.0, 4.5, 1.8, 0.0, 0.0)
    before = search([box], station=0.3)
    after = search([(box[0] - 0.4, *box[1:])], station=0.7)
    grid = before.stations[1:] + 0.3
    assert np.allclose((after.stations[1:] + 0.7)[:-1], grid[:-1]) or np.allclose(
        (after.stations[1:] + 0.7)[:-1], grid[1:]
    )


@pytest.mark.parametrize("speed", [0.0, 2.0, 7.0, 35.0])
def test_any_speed_gives_a_finite_path(speed):
    path = search([(30.0, 0.0, 4.0, 1.8, 0.0, 2.0)], speed=speed)
    assert np.isfinite(path.offsets).all()
    assert np.isfinite(path.cost)


@pytest.mark.parametrize("speed", [0.0, 4.0, 15.0, 20.0])
def test_arrival_times_are_those_of_the_simulated_car(speed):
    stations, t, s, v, simulated = np.linspace(1.0, 60.0, 60), 0.0, 0.0, speed, []
    for station in stations:
        while s < station:
            v_next = max(min(v + 3.0 * 1e-4, 15.0), v if v > 15.0 else 0.0)
            s, v, t = s + 0.5e-4 * (v + v_next), v_next, t + 1e-4
        simulated.append(t)
    assert arrival_times(stations, speed, 15.0, 3.0) == pytest.approx(simulated, abs=2e-3)


def test_slow_leader_blocks_even_when_followed_at_its_speed():
    """At the leader's own speed it would never be reached; at the cruising speed it would."""
    box = np.array([[7.0, 0.0, 4.5, 6.5, 0.0, 5.0]])
    polygons = obstacle_polygons(box, np.zeros(1))
    everywhere = np.full(1, math.inf)
    view = View(polygons, np.array([5.0]), np.zeros(1, np.int64), everywhere)
    path = plan_path(Start(0.0, 0.0, 5.0, 15.0), view, SETTINGS)
    assert PlannedPath(*path).blocker == 0
