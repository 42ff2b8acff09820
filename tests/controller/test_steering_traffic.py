"""The stepping controller among others: held up, followed, overtaking, and what appears late."""

import numpy as np
import pytest
import shapely
import shapely.affinity
from support.steering_drive import BMW, ROAD, drive, footprint, good_state

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.signals import Status, VehicleState


@pytest.mark.closed_loop
def test_blocked_road_stops_the_car_before_it():
    wall = (Obstacle(80.0, 0.0, 1.0, 12.0),)
    states, commands, plans = drive(wall, duration=14.0)
    assert states[-1].v_x < 0.1
    gap = 79.5 - BMW.front_extent - states[-1].x
    assert 0.5 < gap < 4.0
    assert Status.BLOCKED in {command.status for command in commands}
    targets = [command.target_speed for command in commands]
    assert targets[-1] < 0.5
    assert max(np.diff(targets)) < 0.05
    assert min(plan.stop_distance for plan in plans) < 2.0


@pytest.mark.closed_loop
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_car_that_is_held_up_waits_beside_the_lane_of_what_comes(mirror):
    standing = Obstacle(34.0, -2.2 * mirror, 4.0, 3.0)
    oncoming = Obstacle(60.0, 1.2 * mirror, 4.5, 1.8, speed=-8.0)
    states, _, _ = drive((standing, oncoming), duration=12.0)
    for state in states:
        middle = oncoming.s + oncoming.speed * state.time
        box = shapely.box(middle - 2.25, oncoming.l - 0.9, middle + 2.25, oncoming.l + 0.9)
        assert footprint(state).distance(box) > 0.1
        assert footprint(state).distance(shapely.box(32.0, standing.l - 1.5, 36.0, standing.l + 1.5)) > 0.1
    assert min(state.v_x for state in states) < 8.0
    assert states[-1].x > 60.0
    assert mirror * np.interp(34.0, [state.x for state in states], [state.y for state in states]) > 0.3


@pytest.mark.closed_loop
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_car_does_not_stop_before_a_slow_one_that_it_has_overtaken(mirror):
    slow, wall = Obstacle(25.0, -1.2 * mirror, 4.5, 1.8, speed=4.0), Obstacle(110.0, 0.0, 1.0, 12.0)
    states, _, _ = drive((slow, wall), start=VehicleState(v_x=12.0), duration=30.0)
    for state in states:
        middle = slow.s + slow.speed * state.time
        box = shapely.box(middle - 2.25, slow.l - 0.9, middle + 2.25, slow.l + 0.9)
        assert footprint(state).distance(box) > 0.1
    assert states[-1].v_x < 0.1
    assert 100.0 < states[-1].x + BMW.front_extent < 109.5


@pytest.mark.parametrize(("obstacle", "slows"), [
    (Obstacle(12.0, 0.0, 4.5, 1.8), True),
    (Obstacle(20.0, 0.0, 4.5, 1.8, speed=-10.0), False),
])  # fmt: skip
def test_slows_down_only_for_what_that_helps_against(obstacle, slows):
    controller = SteeringController(BMW, ROAD, (obstacle,))
    command = controller.step(good_state(0.0))
    assert controller.plan.slack_corridor > 0.2
    assert (command.target_speed < 15.0) == slows


def test_the_edge_of_the_road_counts_where_nothing_comes_yet():
    leaving = VehicleState(v_x=15.0, y=-2.2, yaw=-0.18)
    far = Obstacle(62.0, 2.2, 4.5, 1.8, speed=-10.0)
    targets = [SteeringController(BMW, ROAD, boxes).step(leaving).target_speed for boxes in ((), (far,))]
    assert targets[0] < 15.0
    assert targets[1] == pytest.approx(targets[0], abs=0.2)


@pytest.mark.closed_loop
def test_a_follower_is_no_reason_to_stop():
    """Behind a slow car, beside a lane full of oncoming ones, with somebody behind: go on as without him."""
    lead, behind = Obstacle(16.0, -1.2, 4.5, 1.8, speed=5.0), Obstacle(-12.0, -1.2, 4.5, 1.8, speed=5.0)
    oncoming = tuple(Obstacle(60.0 + 25.0 * i, 1.8, 4.5, 1.8, speed=-10.0) for i in range(7))
    start = VehicleState(v_x=5.0, y=-1.2)
    states, _, _ = drive((lead, behind, *oncoming), ControllerConfig(cruise_speed=12.0), start=start)
    for state in states:
        for slow in (lead, behind):
            middle = slow.s + slow.speed * state.time
            box = shapely.box(middle - 2.25, slow.l - 0.9, middle + 2.25, slow.l + 0.9)
            assert footprint(state).distance(box) > 0.5
    assert min(state.v_x for state in states) > 4.0


def test_a_car_that_is_held_up_does_not_turn_into_the_one_beside_it():
    beside, wall = Obstacle(-1.0, -1.2, 4.5, 1.8, speed=4.0), Obstacle(45.0, 2.0, 1.0, 7.0)
    config = ControllerConfig(width_left=5.0, width_right=6.0)
    controller = SteeringController(BMW, ROAD, (beside, wall), config)
    m = controller._memory
    m["held_up"], m["obstacles"], m["ids"][0, :1], m["sides"][0, :1] = True, 1, 0, 1
    controller.step(VehicleState(y=1.4, v_x=15.0))
    assert controller.plan.sides[0] == 1
    assert controller.plan.slack_corridor < 0.5


@pytest.mark.closed_loop
def test_slow_leader_is_followed_at_a_gap():
    leader = Obstacle(40.0, 0.0, 4.5, 6.5, speed=5.0)
    states, commands, plans = drive((leader,), duration=12.0)
    gaps = [leader.at(s.time).s - 2.25 - s.x - BMW.front_extent for s in states]
    assert min(gaps) > 1.0
    assert states[-1].v_x == pytest.approx(5.0, abs=0.3)
    assert {command.status for command in commands[200:]} == {Status.BLOCKED}
    assert abs(states[-1].y) < 0.05
    assert all(plan.feasible for plan in plans)


@pytest.mark.closed_loop
def test_drives_on_when_the_road_clears():
    crossing = (Obstacle(60.0, -9.0, 2.0, 2.0), Obstacle(45.0, 0.0, 4.5, 7.0, speed=12.0))
    states, commands, _ = drive(crossing, start=VehicleState(v_x=5.0), config=ControllerConfig(cruise_speed=10.0))
    assert commands[-1].target_speed == 10.0
    assert states[-1].v_x > 9.0


@pytest.mark.closed_loop
@pytest.mark.parametrize("distance", [20.0, 25.0, 30.0])
def test_box_that_appears_late_is_still_passed(distance):
    box = Obstacle(distance, 0.0, 4.5, 1.8)
    states, _, _ = drive((box,), duration=5.0)
    shape = shapely.box(box.s - 2.25, -0.9, box.s + 2.25, 0.9)
    assert min(footprint(state).distance(shape) for state in states) > 0.15


@pytest.mark.closed_loop
@pytest.mark.parametrize(("distance", "gap"), [(20.0, 0.5), (25.0, 1.0), (60.0, 1.5)])
def test_wall_that_appears_late_is_braked_for(distance, gap):
    states, commands, _ = drive((Obstacle(distance + 0.5, 0.0, 1.0, 12.0),), duration=14.0)
    assert commands[0].status is Status.BLOCKED
    assert states[-1].v_x < 0.1
    assert distance - BMW.front_extent - states[-1].x > gap
