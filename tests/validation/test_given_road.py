import math

import numpy as np
import pytest
import shapely

from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.waypoints import WayPoints
from sidestep.plant_models.road.widths import Widths
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.geometry import car_boxes, edge_clearance

CAR = VehicleParameters.preset("bmw-320i")


def ring(radius, count):
    angle = np.linspace(0.0, math.tau, count, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def test_edges_are_measured_from_the_polyline_not_from_the_path():
    points = np.array([[0.0, 0.0], [30.0, 0.0], [60.0, 8.0], [90.0, 8.0]])
    path = ReferencePath.from_waypoints(points).with_edges(Widths.constant(4.0, 3.0))
    line = shapely.LineString(np.vstack([points, [[200.0, 8.0]]]))
    for s in np.linspace(2.0, 88.0, 23):
        x, y = path.to_cartesian(float(s), 0.7)
        corners = car_boxes(CAR, x, y, path.heading(float(s)) + 0.05)
        left = [shapely.Point(c).distance(line) * _side(points, c) for c in corners[0]]
        expected = min(4.0 - max(left), 3.0 + min(left))
        assert edge_clearance(path, corners, np.array([s]))[0] == pytest.approx(expected, abs=1e-9)


def _side(points, corner):
    nearest = min(range(3), key=lambda i: shapely.LineString(points[i : i + 2]).distance(shapely.Point(corner)))
    a, b = points[nearest], points[nearest + 1]
    return math.copysign(1.0, (b[0] - a[0]) * (corner[1] - a[1]) - (b[1] - a[1]) * (corner[0] - a[0]))


def test_widths_of_the_way_points_hold_between_them():
    points = np.column_stack([np.arange(0.0, 101.0, 20.0), np.zeros(6)])
    left = np.array([2.0, 2.0, 4.0, 4.0, 2.0, 2.0])
    path = ReferencePath.through(WayPoints(points, str, "road", left, np.full(6, 3.0)))
    corners = car_boxes(CAR, np.array([30.0, 50.0]), np.array([1.0, 1.0]), np.zeros(2))
    front, half = 30.0 - CAR.rear_extent, CAR.width / 2.0
    expected = 2.0 + (front - 20.0) / 10.0 - 1.0 - half  # narrowest at the rear corner
    np.testing.assert_allclose(edge_clearance(path, corners, np.array([30.0, 50.0])), [expected, 3.0 - half], atol=1e-9)


def test_a_closed_road_has_no_seam():
    path = ReferencePath.from_waypoints(ring(40.0, 120)).with_edges(Widths.constant(3.0, 3.0))
    assert path.closed
    clearances = []
    for angle in (-0.02, 0.0, 0.02, 3.0):
        x, y = 40.0 * math.cos(angle), 40.0 * math.sin(angle)
        corners = car_boxes(CAR, x, y, angle + math.pi / 2.0)
        clearances.append(edge_clearance(path, corners, path.project(x, y)[0] + path.length * np.ones(1))[0])
    np.testing.assert_allclose(clearances, clearances[-1], atol=0.02)
    assert clearances[0] == pytest.approx(3.0 - CAR.width / 2.0, abs=0.1)


def test_the_other_leg_of_a_hairpin_is_not_taken_for_this_one():
    angle = np.linspace(-math.pi / 2.0, math.pi / 2.0, 15)
    bend = np.column_stack([100.0 + 8.0 * np.cos(angle), 8.0 + 8.0 * np.sin(angle)])
    points = np.vstack([np.column_stack([np.arange(0.0, 100.0, 5.0), np.zeros(20)]), bend,
                        np.column_stack([np.arange(95.0, -1.0, -5.0), np.full(20, 16.0)])])  # fmt: skip
    path = ReferencePath.from_waypoints(points, closed=False).with_edges(Widths.constant(12.0, 4.0))
    corners = car_boxes(CAR, 20.0, 11.0, 0.0)  # nearer to the other leg
    assert edge_clearance(path, corners, np.array([20.0]))[0] == pytest.approx(1.0 - CAR.width / 2.0, abs=1e-6)
