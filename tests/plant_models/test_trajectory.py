import json
import math
import pickle

import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import FOREVER, Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc, Line
from sidestep.plant_models.trajectory import Trajectory

ROAD = ReferencePath.from_segments([Line(40.0), Arc(60.0, 0.02)])


def test_constant_speed_where_there_is_no_trajectory():
    box = Obstacle(10.0, 1.0, 4.0, 2.0, heading=0.1, speed=5.0)
    np.testing.assert_allclose(box.track([0.0, 2.0]), [[10.0, 20.0], [1.0, 1.0], [0.1, 0.1], [5.0, 5.0]])
    assert box.at(2.0) == Obstacle(20.0, 1.0, 4.0, 2.0, heading=0.1, speed=5.0)
    assert box.moves
    assert not Obstacle(10.0, 1.0, 4.0, 2.0).moves


def test_a_trajectory_is_linear_in_between_and_stands_outside():
    way = Trajectory([1.0, 3.0, 5.0], [10.0, 20.0, 20.0], [0.0, 2.0, 4.0], [0.0, 0.2, 0.2])
    box = Obstacle.along(way, 4.0, 2.0)
    np.testing.assert_allclose(box.track([0.0, 2.0, 4.0, 9.0])[:3].T, [
        [10.0, 0.0, 0.0], [15.0, 1.0, 0.1], [20.0, 3.0, 0.2], [20.0, 4.0, 0.2],
    ])  # fmt: skip
    assert [box.at(time).speed for time in (0.0, 2.0, 4.0, 9.0)] == [0.0, 5.0, 0.0, 0.0]
    assert box.at(2.0).trajectory is None  # it goes on at the speed that it has


def test_a_way_in_the_world_is_the_same_from_the_road():
    time = np.linspace(0.0, 4.0, 9)
    x, y, yaw = 60.0 + 5.0 * time, 2.0 - 0.5 * time, 3.0 + 0.1 * time
    way = Trajectory.in_world(ROAD, time, x, y, yaw)
    fine = np.linspace(0.0, 4.0, 333)
    s, offset, heading, _ = way.at(fine)
    px, py = ROAD.to_cartesian(s, offset)
    np.testing.assert_allclose(px, 60.0 + 5.0 * fine, atol=1e-3)
    np.testing.assert_allclose(py, 2.0 - 0.5 * fine, atol=1e-3)
    np.testing.assert_allclose(ROAD.heading(s) + heading, 3.0 + 0.1 * fine, atol=1e-3)
    box = Obstacle.along(way, 1.0, 1.0)
    assert box.pose(ROAD, 2.0) == pytest.approx((70.0, 1.0, 3.2))
    assert pickle.loads(pickle.dumps(box)).pose(ROAD, 2.0) == box.pose(ROAD, 2.0)


def test_yaw_that_wraps_is_continuous():
    way = Trajectory.in_world(ROAD, [0.0, 1.0], [0.0, 1.0], [0.0, 0.0], [math.pi - 0.1, -math.pi + 0.1])
    assert way.at(0.5)[2] == pytest.approx(math.pi)


def test_it_is_there_from_its_appearing_until_it_vanishes():
    box = Obstacle(0.0, 0.0, 1.0, 1.0, appears=1.0, vanishes=2.0)
    assert box.is_there([0.5, 1.0, 1.9, 2.0]).tolist() == [False, True, True, False]
    assert box.moves
    assert Obstacle(0.0, 0.0, 1.0, 1.0).vanishes == FOREVER


@pytest.mark.parametrize(
    ("columns", "where"),
    [
        (([0.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]), "trajectory.time"),
        (([0.0, 1.0], [0.0], [0.0, 0.0], [0.0, 0.0]), "trajectory.s"),
        (([0.0, 1.0], [0.0, 1.0], [0.0, math.nan], [0.0, 0.0]), "trajectory.l"),
        (([], [], [], []), "trajectory.time"),
    ],
)
def test_what_is_no_trajectory_is_refused(columns, where):
    with pytest.raises(InputError) as caught:
        Trajectory(*map(np.array, columns))
    assert caught.value.where == where


def test_an_obstacle_comes_back_from_a_file():
    way = Trajectory.in_world(ROAD, [0.0, 1.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.1])
    for box in (Obstacle(1.0, 2.0, 3.0, 4.0, speed=5.0), Obstacle.along(way, 4.0, 2.0, vanishes=3.0)):
        again = Obstacle.from_plain(json.loads(json.dumps(box.to_plain())))
        assert again.pose(ROAD, 0.7) == box.pose(ROAD, 0.7)
        np.testing.assert_array_equal(again.track([0.0, 0.3]), box.track([0.0, 0.3]))
        assert again.vanishes == box.vanishes
