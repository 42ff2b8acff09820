"""Exact intervals against sampling, and footprint bounds against geometry."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.controller.decision.corridor import (
    Motion,
    Outline,
    Way,
    corridor_bounds,
    excess_over,
    footprint_bounds,
    lateral_interval,
    obstacle_polygons,
    path_reference,
)
from sidestep.controller.decision.view import View
from sidestep.controller.records import GRID, NODES, WORK, filled
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc


def seen(outlines, speed=0.0):
    count = len(outlines)
    return View(outlines, np.full(count, speed), np.zeros(count, np.int64), np.full(count, np.inf))


def polygon_of(box, curvature=0.0):
    return obstacle_polygons(np.array([box], dtype=float), np.array([curvature]))[0]


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-math.pi, math.pi), st.floats(0.5, 6.0), st.floats(0.3, 3.0), st.floats(-6.0, 6.0), st.floats(0.0, 4.0)
)
def test_interval_is_that_of_the_clipped_polygon(heading, length, width, start, reach):
    outline = polygon_of((0.0, 0.5, length, width, heading, 0.0))
    low, high = lateral_interval(outline, 0.0, start, start + reach)
    clipped = shapely.Polygon(outline).intersection(shapely.box(start, -50.0, start + reach, 50.0))
    if clipped.is_empty:
        assert low > high
    else:
        assert (low, high) == pytest.approx((clipped.bounds[1], clipped.bounds[3]), abs=1e-9)


def test_box_on_a_bend_is_its_cartesian_box():
    road, s, l, heading = ReferencePath.from_segments([Arc(80.0, 0.02)]), 40.0, 1.0, 0.3  # noqa: E741
    x, y = road.to_cartesian(s, l)
    yaw = road.heading(s) + heading
    a, b = np.array([2.25, 0.0, -2.25, -2.25, 2.25]), np.array([0.9, 0.9, 0.9, -0.9, -0.9])
    corners = road.project(x + a * math.cos(yaw) - b * math.sin(yaw), y + a * math.sin(yaw) + b * math.cos(yaw))
    outline = polygon_of((s, l, 4.5, 1.8, heading, 0.0), 0.02)[[1, 2, 3, 5, 7]]
    assert outline[:, 0] == pytest.approx(corners[0], abs=0.02)
    assert outline[:, 1] == pytest.approx(corners[1], abs=5e-3)


def test_bounds_are_the_nearest_faces_on_each_side():
    outlines = np.stack([polygon_of((10.0, 2.5, 4.0, 1.0, 0.0, 0.0)), polygon_of((11.0, -2.0, 4.0, 1.0, 0.0, 0.0))])
    stations, reach, times = np.array([5.0, 8.5, 11.0, 20.0]), np.full(4, 0.5), np.zeros(4)
    way, view = Way(stations, times, reach, np.zeros(4), np.zeros(4)), seen(outlines)
    right, left = corridor_bounds(way, view, np.array([-1, 1]), (-4.0, 4.0), 0.0)
    assert left == pytest.approx([4.0, 2.0, 2.0, 4.0])
    assert right == pytest.approx([-4.0, -1.5, -1.5, -4.0])
    ignored, _ = corridor_bounds(way, view, np.array([-1, 0]), (-4.0, 4.0), 0.0)
    assert ignored == pytest.approx(np.full(4, -4.0))


def test_a_box_bounds_the_path_where_it_begins_and_ends():
    """Between two stations the bound is that of the path through the box's corner, a parabola."""
    outline = polygon_of((10.0, 2.5, 4.0, 1.0, 0.0, 0.0))[None]  # from 8 to 12 m, right face at 2 m
    stations, direction, bend = np.array([6.0, 7.5, 10.0, 12.5]), np.full(4, 0.1), np.full(4, 0.02)

    def left(buffer):
        way = Way(stations, np.zeros(4), np.ones(4), direction, bend)
        return corridor_bounds(way, seen(outline), np.array([-1]), (-4.0, 4.0), buffer)[1]

    def carried(away):
        return 2.0 - 0.1 * away - 0.01 * away**2

    assert left(0.0) == pytest.approx([4.0, carried(0.5), 2.0, carried(-0.5)])
    assert left(0.3) == pytest.approx([4.0, carried(0.2), 2.0, carried(-0.2)])


def test_moving_box_is_where_it_is_at_the_time():
    outline = polygon_of((10.0, 2.5, 4.0, 1.0, 0.0, 5.0))[None]
    way = Way(np.array([10.0, 10.0]), np.array([0.0, 2.0]), np.zeros(2), np.zeros(2), np.zeros(2))
    _, left = corridor_bounds(way, seen(outline, 5.0), np.array([-1]), (-4.0, 4.0), 0.0)
    assert left == pytest.approx([2.0, 4.0])


def test_footprint_bounds_hold_the_whole_side_of_a_turning_car():
    """A car whose two ends just touch their bounds keeps its whole side out of the box, swept along a circle."""
    radius, front, rear, half = 40.0, 2.1, 2.4, 0.8
    turn = 1.0 / radius
    still = np.zeros(1)
    motion = Motion(still, still, still, still, np.array([turn]), still)
    car = Outline(np.array([front, -rear]), np.array([half]))
    outline = polygon_of((0.0, 3.0, 60.0, 2.0, 0.0, 0.0))[None]
    bounds = footprint_bounds(motion, seen(outline), np.array([-1]), (-9.0, 9.0), 0.0, car)
    chord = (front + rear) ** 2 / 8.0 / radius
    assert bounds[1, 0] == pytest.approx(2.0 - half - chord)
    assert bounds[0, 0] == pytest.approx(-9.0 + half)


def test_contradicting_bounds_close_to_one_line():
    outlines = np.stack([polygon_of((0.0, 1.0, 9.0, 1.0, 0.0, 0.0)), polygon_of((0.0, -1.0, 9.0, 1.0, 0.0, 0.0))])
    still = np.zeros(1)
    car = Outline(np.array([2.0, -2.0]), np.array([0.9]))
    motion = Motion(still, still, still, still, still, still)
    bounds = footprint_bounds(motion, seen(outlines), np.array([-1, 1]), (-4.0, 4.0), 0.0, car)
    assert bounds[:, 0] == pytest.approx(np.zeros(4), abs=1e-12)


def test_reference_is_interpolated_with_its_mean_slope():
    stations = np.linspace(0.0, 10.0, 11)
    offset, slope = path_reference(stations, 0.2 * stations, np.array([2.5, 5.0]), 1.0)
    assert offset == pytest.approx([0.5, 1.0])
    assert slope == pytest.approx([0.2, 0.2])


def test_excess_is_the_worst_of_both_ends_and_the_first_that_counts():
    grid = filled(GRID, {"nodes": 3, "times": [0.05, 0.2, 0.4], "levers": (2.0, -2.0)})[0]
    work = filled(WORK, {"slowing_bounds": np.tile([[-0.5], [0.5], [-0.5], [0.5]], NODES)})
    assert excess_over(work[0], grid) == (0.0, math.inf)
    states = work["states"][0]
    states[1:4, 0], states[1:4, 1] = [3.0, 0.505, 0.4], [0.0, 0.0, 0.1]
    worst, first = excess_over(work[0], grid)
    assert worst == pytest.approx(0.1)  # the front end of the last; the first node is too early to count
    assert first == 0.4
