"""The acceleration that is commanded: where it stops the car, how it follows, and that it asks nothing of the plant."""

import math

import numpy as np
import pytest

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.controller.decision.stopping import GRIP_SHARE
from sidestep.controller.records import PROFILE, WORK, record
from sidestep.controller.speed import STOP_TIME, needed_braking, speed_ahead
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc, Clothoid, Line
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
ROAD = ReferencePath.from_segments([Line(400.0)])
PERIOD = 0.02


def drive(obstacles, speed=15.0, duration=10.0, road=ROAD, config=None):
    """Times, states as rows [x, v_x] and commands of a closed loop on the linear plant."""
    controller = SteeringController(BMW, road, obstacles, config)
    states, commands = [], []
    with LinearPlant(BMW) as plant:
        state = plant.reset(VehicleState(v_x=speed))
        for _ in range(round(duration / PERIOD)):
            commands.append(controller.step(state))
            states.append((state.time, state.x, state.v_x))
            state = plant.step(commands[-1], PERIOD)
    return np.array(states).T, commands


def test_needed_braking_stops_within_the_distance():
    for closing, distance in ((15.0, 40.0), (5.0, 3.0)):
        braking = needed_braking(closing, distance)
        assert closing * (closing / braking) - 0.5 * braking * (closing / braking) ** 2 == pytest.approx(distance)
    assert needed_braking(-1.0, 5.0) == 0.0
    assert needed_braking(1.0, -2.0) == pytest.approx(1.0 / STOP_TIME)


@pytest.mark.parametrize("braking", [-2.0, 3.2])
def test_the_profile_is_read_at_a_time(braking):
    """v^2 falls linearly over the way where v falls linearly over time."""
    work = record(WORK)
    way = 0.5 * np.arange(PROFILE)
    work["profile_step"] = 0.5
    work["profile_speed"][0] = np.sqrt(np.maximum(8.0**2 - 2.0 * braking * way, 0.0))
    for later in (0.05, 0.25, 0.9):
        assert speed_ahead(work[0], later) == pytest.approx((8.0 - braking * later, later), rel=1e-9)
    if braking > 0.0:
        speed, time = speed_ahead(work[0], 60.0)
        assert (speed, time) == (0.0, pytest.approx(2.5))


@pytest.mark.closed_loop
def test_a_comfortable_stop_is_where_it_is_meant_and_no_harder():
    wall = (Obstacle(80.0, 0.0, 1.0, 12.0),)
    (_, x, v), commands = drive(wall, duration=14.0)
    wanted = np.array([command.acceleration for command in commands])
    gap = 79.5 - BMW.front_extent - x[-1]
    assert gap == pytest.approx(ControllerConfig().standstill_gap, abs=0.05)
    assert wanted.min() >= -1.05 * ControllerConfig().comfort_braking
    stands = np.flatnonzero(v < 1e-3)
    assert len(stands) > 50
    assert x[-1] - x[stands[0]] < 1e-3
    assert np.all(wanted[stands] < 0.0)  # the brakes hold it


@pytest.mark.closed_loop
@pytest.mark.parametrize(("distance", "hardest"), [(22.0, 8.0), (26.0, 8.0)])
def test_a_box_too_late_for_comfort_is_braked_for_at_once(distance, hardest):
    wall = (Obstacle(distance, 0.0, 1.0, 12.0),)
    (_, x, v), commands = drive(wall, duration=6.0)
    assert commands[0].acceleration == -min(hardest, BMW.max_braking)
    assert v[-1] < 1e-3
    assert distance - 0.5 - BMW.front_extent - x[-1] > 1.0


@pytest.mark.closed_loop
@pytest.mark.parametrize("speed", [8.0, 12.0])
def test_a_leader_is_followed_without_hunting(speed):
    road = (Obstacle(50.0, 0.0, 4.5, 7.9, speed=speed),)
    (_, x, v), commands = drive(road, duration=24.0)
    wanted = np.array([command.acceleration for command in commands])
    assert v[-100:] == pytest.approx(speed, abs=0.05)
    assert np.abs(wanted[-100:]).max() < 0.1
    assert wanted.min() >= -1.05 * ControllerConfig().comfort_braking
    assert v.min() > speed - 0.2
    gap = 50.0 + speed * PERIOD * np.arange(len(x)) - 2.25 - x - BMW.front_extent
    assert gap.min() > 0.9 * ControllerConfig().standstill_gap


@pytest.mark.closed_loop
def test_a_bend_is_entered_at_the_speed_of_the_profile():
    road = ReferencePath.from_segments([Line(80.0), Clothoid(20.0, 0.0, 0.05), Arc(60.0, 0.05)])
    (_, _, v), commands = drive((), speed=20.0, duration=11.0, road=road)
    wanted = np.array([command.acceleration for command in commands])
    assert wanted.min() >= -1.05 * ControllerConfig().comfort_braking
    assert v[-1] == pytest.approx(math.sqrt(ControllerConfig().bend_acceleration / 0.05), abs=0.1)


def test_a_free_road_at_speed_asks_for_nothing_and_a_slow_car_drives_up():
    config = ControllerConfig(cruise_speed=15.0)
    assert SteeringController(BMW, ROAD, (), config).step(VehicleState(v_x=15.0)).acceleration == 0.0
    assert SteeringController(BMW, ROAD, (), config).step(VehicleState(v_x=5.0)).acceleration == pytest.approx(
        BMW.max_acceleration
    )
    start = SteeringController(BMW, ROAD, (), config).step(VehicleState())
    assert start.acceleration == pytest.approx(BMW.max_acceleration)


def test_a_car_that_stands_and_is_to_stand_brakes():
    blocked = (Obstacle(BMW.front_extent + 2.5, 0.0, 1.0, 12.0),)
    config = ControllerConfig(cruise_speed=15.0)
    command = SteeringController(BMW, ROAD, blocked, config).step(VehicleState())
    assert command.status is Status.BLOCKED
    assert command.acceleration == -config.comfort_braking


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_braking_stays_within_the_grip(friction):
    wall = (Obstacle(14.0, 0.0, 1.0, 12.0),)
    controller = SteeringController(BMW, ROAD, wall, ControllerConfig(friction=friction))
    assert -GRIP_SHARE * friction * GRAVITY - 1e-9 <= controller.step(VehicleState(v_x=15.0)).acceleration < -1.0


def test_a_controller_without_input_brakes():
    controller = SteeringController(BMW, ROAD)
    assert math.isnan(controller.command.acceleration)  # nothing asked yet: the target speed, 0, counts
    good = controller.step(VehicleState(v_x=10.0))
    lost = VehicleState(time=0.02, v_x=math.nan)
    held = [controller.step(lost) for _ in range(60)]
    assert held[0].acceleration == good.acceleration
    assert held[-1].status is Status.FAULT
    assert held[-1].acceleration == -ControllerConfig().comfort_braking


def test_whoever_gives_a_command_by_place_says_the_same_as_before():
    command = SteeringCommand(0.0, 0.1, 12.0, Status.DEGRADED)
    assert (command.target_speed, command.status, math.isnan(command.acceleration)) == (12.0, Status.DEGRADED, True)
    with pytest.raises(TypeError):
        SteeringCommand(0.0, 0.1, 12.0, Status.DEGRADED, -1.0)
