"""Obstacles of the MuJoCo plant: plane geometry, crashes, motion along the road."""

import math

import numpy as np
import pytest
from shapely import affinity, box

from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.trajectory import Trajectory
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")


def footprint(state, front, rear, width):
    shape = box(-rear, -width / 2.0, front, width / 2.0)
    return affinity.translate(affinity.rotate(shape, state.yaw, origin=(0, 0), use_radians=True), state.x, state.y)


def test_clearance_is_the_plane_distance_of_the_rectangles():
    rng = np.random.default_rng(7)
    obstacle = Obstacle(3.0, 1.0, 4.5, 1.8, heading=0.4)
    shape = affinity.rotate(box(3.0 - 2.25, 1.0 - 0.9, 3.0 + 2.25, 1.0 + 0.9), 0.4, use_radians=True)
    plant, apart = MujocoPlant(BMW, obstacles=[obstacle, Obstacle(500.0, 0.0, 1.0, 1.0)]), 0
    for x, y, yaw in rng.uniform((-6, -6, -math.pi), (12, 8, math.pi), (200, 3)):
        state = plant.reset(VehicleState(x=x, y=y, yaw=yaw))
        expected = footprint(state, BMW.front_extent, BMW.rear_extent, BMW.width).distance(shape)
        assert plant.clearance() == pytest.approx(expected, abs=1e-9)
        plant.step(SteeringCommand(0.0, 0.0, 0.0), 1e-3)
        assert plant.collided == (expected == 0.0)
        apart += expected > 0.0
    assert 50 < apart < 190
    assert MujocoPlant(BMW).clearance() == math.inf


def test_clearance_is_that_of_the_state_just_returned():
    plant = MujocoPlant(BMW, obstacles=[Obstacle(30.0, 0.0, 2.0, 2.0)])
    state = plant.reset(VehicleState(v_x=15.0))
    for _ in range(50):
        state = plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)
        assert plant.clearance() == pytest.approx(29.0 - state.x - BMW.front_extent, abs=2e-3)


def test_a_crash_stops_the_car():
    plant = MujocoPlant(BMW, obstacles=[Obstacle(15.0, 0.0, 2.0, 3.0)])
    state, touching, collided = plant.reset(VehicleState(v_x=10.0)), [], []
    for _ in range(150):
        touching.append(plant.clearance() == 0.0)
        collided.append(plant.collided)
        state = plant.step(SteeringCommand(0.0, 0.0, 10.0), 0.01)
    assert not touching[0]
    assert collided.index(True) - touching.index(True) in (0, 1)
    assert plant.collided
    assert state.x + BMW.front_extent < 14.2
    assert state.v_x < 1.0
    plant.reset(VehicleState())
    assert not plant.collided


def test_obstacles_drive_along_the_road():
    road = ReferencePath.from_segments([Arc(length=100.0, curvature=0.02)])
    plant = MujocoPlant(BMW, path=road, obstacles=[Obstacle(10.0, 1.0, 4.0, 2.0, heading=0.1, speed=8.0)])
    state = plant.reset(VehicleState(time=2.0))
    for _ in range(30):
        s = 10.0 + 8.0 * state.time
        assert plant.data.mocap_pos[0] == pytest.approx([*road.to_cartesian(s, 1.0), 0.0], abs=1e-9)
        yaw = 2.0 * math.atan2(plant.data.mocap_quat[0, 3], plant.data.mocap_quat[0, 0])
        assert yaw == pytest.approx(road.heading(s) + 0.1, abs=1e-9)
        state = plant.step(SteeringCommand(0.0, 0.0, 0.0), 0.02)


def test_an_obstacle_from_behind_pushes_the_car():
    plant = MujocoPlant(BMW, obstacles=[Obstacle(-10.0, 0.0, 4.0, 2.0, speed=5.0)])
    state = plant.reset(VehicleState())
    for _ in range(250):
        state = plant.step(SteeringCommand(0.0, 0.0, 0.0), 0.01)
    assert plant.collided
    assert state.x > 3.0


def test_a_box_follows_its_trajectory_comes_and_goes():
    road = ReferencePath.from_segments([Arc(80.0, 0.02)])
    time, x, y = [0.0, 0.5, 1.0], [20.0, 20.0, 24.0], [-6.0, 4.0, 4.0]
    way = Trajectory.in_world(road, time, x, y, [1.5, 1.5, 0.0])
    plant = MujocoPlant(BMW, road, [Obstacle.along(way, 2.0, 1.0, appears=0.1, vanishes=0.9)])
    state = plant.reset(VehicleState(v_x=5.0))
    assert plant.clearance() > 50.0  # not there yet
    for k in range(1, 10):
        state = plant.step(SteeringCommand(0.0, 0.0, 5.0), 0.1)
        there = 1 <= k < 9
        centre = [float(np.interp(0.1 * k, time, values)) for values in (x, y, [1.5, 1.5, 0.0])]
        outline = affinity.rotate(box(-1.0, -0.5, 1.0, 0.5), centre[2], origin=(0, 0), use_radians=True)
        expected = footprint(state, BMW.front_extent, BMW.rear_extent, BMW.width).distance(
            affinity.translate(outline, *centre[:2])
        )
        if there:
            assert plant.clearance() == pytest.approx(expected, abs=0.02)
        else:
            assert plant.clearance() > 50.0
    assert not plant.collided
