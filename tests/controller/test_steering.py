"""The stepping controller: scenes on the linear plant, the fallback ladder, hostile input."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.controller.answer import SHIFTED_PLAN_TIME
from sidestep.controller.mpc.status import ITERATION_LIMIT
from sidestep.controller.step import BOUNDED, prepare
from sidestep.plant_models.linear.bicycle import continuous
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import Arc, Line, ReferencePath
from sidestep.plant_models.signals import Status, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
ROAD = ReferencePath.from_segments([Line(200.0)])
SINGLE = (Obstacle(40.0, 0.0, 4.5, 1.8),)
DOUBLE = (Obstacle(40.0, -0.6, 4.5, 1.8), Obstacle(70.0, 0.8, 4.5, 1.8))


def drive(obstacles, config=None, road=ROAD, start=None, duration=8.0, vehicle=BMW, delay=0):
    """States, commands and plans of a closed loop on the linear plant."""
    controller = SteeringController(vehicle, road, obstacles, config)
    states, commands, plans = [], [], []
    with LinearPlant(vehicle) as plant:
        state = plant.reset(start or VehicleState(v_x=15.0))
        for _ in range(round(duration / 0.02)):
            states.append(state)
            commands.append(controller.step(state))
            plans.append(controller.plan)
            late = commands[-1 - delay] if len(commands) > delay else replace(commands[0], steer_angle=0.0)
            state = plant.step(late, 0.02)
    return states, commands, plans


def footprint(state):
    car = shapely.box(-BMW.rear_extent, -0.5 * BMW.width, BMW.front_extent, 0.5 * BMW.width)
    turned = shapely.affinity.rotate(car, state.yaw, origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, state.x, state.y)


@pytest.mark.closed_loop
@pytest.mark.parametrize("obstacles", [SINGLE, DOUBLE])
def test_scenes_of_the_paper(obstacles):
    states, commands, plans = drive(obstacles)
    assert all(plan.feasible for plan in plans)
    assert {command.status for command in commands} == {Status.TRACKING}
    assert max(plan.slack_corridor for plan in plans) < 1e-3
    offset = np.array([state.y for state in states])
    assert math.sqrt(np.mean(offset[-50:] ** 2)) < 0.02
    boxes = [shapely.box(o.s - 2.25, o.l - 0.9, o.s + 2.25, o.l + 0.9) for o in obstacles]
    assert min(footprint(state).distance(box) for state in states for box in boxes) >= 0.18


@pytest.mark.closed_loop
def test_same_states_give_the_same_bits():
    first, second = drive(DOUBLE, duration=4.0), drive(DOUBLE, duration=4.0)
    assert [c.steer_angle for c in first[1]] == [c.steer_angle for c in second[1]]
    assert all(np.array_equal(a.states, b.states) for a, b in zip(first[2], second[2], strict=True))


def test_reset_forgets():
    controller = SteeringController(BMW, ROAD, DOUBLE)
    states = [VehicleState(time=0.02 * k, x=0.3 * k, v_x=15.0) for k in range(80)]
    first = [controller.step(state).steer_angle for state in states]
    controller.reset()
    assert [controller.step(state).steer_angle for state in states] == first


@pytest.mark.closed_loop
def test_mirrored_scene_gives_mirrored_steering():
    mirrored = tuple(replace(o, l=-o.l) for o in DOUBLE)
    a, b = drive(DOUBLE, duration=3.0)[1], drive(mirrored, duration=3.0)[1]
    assert [c.steer_angle for c in a] == pytest.approx([-c.steer_angle for c in b], abs=1e-6)


@pytest.mark.closed_loop
def test_curved_road_is_followed_without_offset():
    road = ReferencePath.from_segments([Arc(400.0, 0.01)])
    states, _, _ = drive((), road=road, duration=10.0)
    offsets = [road.project(state.x, state.y)[1] for state in states[-100:]]
    assert np.abs(offsets).max() < 0.02


@pytest.mark.closed_loop
@pytest.mark.parametrize("delay", [1, 2])
def test_delay_is_compensated(delay):
    states, _, plans = drive(SINGLE, ControllerConfig(input_delay_steps=delay, tyre_model="linear"), delay=delay)
    assert all(plan.feasible for plan in plans)
    assert abs(states[-1].y) < 0.02


@pytest.mark.closed_loop
def test_steering_stays_within_its_limits():
    _, commands, _ = drive(DOUBLE, start=VehicleState(y=1.5, yaw=-0.3, v_x=12.0))
    angle = np.array([command.steer_angle for command in commands])
    assert np.abs(angle).max() <= BMW.steer_limit + 1e-9
    assert np.abs(np.diff(angle)).max() <= 0.02 * BMW.steer_rate_limit + 1e-9


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


def test_whole_numbers_are_road_widths_too():
    plans = []
    for width in (4, 4.0):
        controller = SteeringController(BMW, ROAD, SINGLE, ControllerConfig(width_left=width, width_right=width))
        controller.step(good_state(0.0))
        plans.append(controller.plan)
    assert np.array_equal(plans[0].left, plans[1].left)
    assert np.array_equal(plans[0].right, plans[1].right)


def test_a_car_that_rolls_back_at_first_is_not_to_go_on_with_that():
    assert SteeringController(BMW, ROAD).step(VehicleState(v_x=-0.01)).target_speed == 0.0


@pytest.mark.closed_loop
def test_comfortable_braking_where_the_distance_allows_it():
    states, _, _ = drive((Obstacle(100.0, 0.0, 1.0, 12.0),), duration=12.0)
    braking = -np.diff([state.v_x for state in states]) / 0.02
    assert braking.max() < ControllerConfig().comfort_braking + 1.0


def good_state(time):
    return VehicleState(time=time, x=15.0 * time, v_x=15.0)


@pytest.mark.parametrize("name", ["time", "x", "y", "yaw", "v_x", "v_y", "yaw_rate", "steer_angle"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_input_that_is_not_finite_never_reaches_the_solver(name, value):
    controller = SteeringController(BMW, ROAD, SINGLE)
    for k in range(5):
        controller.step(good_state(0.02 * k))
    command = controller.step(replace(good_state(0.1), **{name: value}))
    assert math.isfinite(command.steer_angle)
    assert command.status is Status.DEGRADED
    assert controller.plan is not None
    assert controller.plan.solver_status == "INPUT"
    assert controller.step(good_state(0.12)).status is Status.TRACKING


def test_stale_input_follows_the_shifted_plan_and_then_holds():
    controller = SteeringController(BMW, ROAD, SINGLE, ControllerConfig(reject_disturbance=False))
    for k in range(60):
        controller.step(good_state(0.02 * k))
    planned = controller.plan
    assert planned is not None
    commands = [controller.step(good_state(1.18)) for _ in range(30)]
    shifted = [c for c in commands if c.status is Status.DEGRADED]
    assert len(shifted) == round(SHIFTED_PLAN_TIME / 0.02)
    for k, command in enumerate(shifted):
        at = 0.02 * (k + 2)
        assert command.steer_angle == pytest.approx(np.interp(at, planned.states_time, planned.states[:, 5]), abs=2e-3)
    held = commands[len(shifted) :]
    assert {c.status for c in held} == {Status.FAULT}
    assert len({c.steer_angle for c in held}) == 1
    assert held[-1].target_speed < held[0].target_speed < 15.0


def test_bad_input_from_the_first_step_on():
    controller = SteeringController(BMW, ROAD, SINGLE)
    command = controller.step(VehicleState(time=math.nan))
    assert command.status is Status.FAULT
    assert (command.steer_angle, command.target_speed) == (0.0, 0.0)
    assert controller.step(good_state(0.0)).status is Status.TRACKING


def test_failing_solver_is_survived(monkeypatch):
    controller = SteeringController(BMW, ROAD, SINGLE)
    for k in range(20):
        controller.step(good_state(0.02 * k))

    def stuck(work, _):
        work["solver_status"] = ITERATION_LIMIT
        work["z"][:] = math.nan
        return False

    monkeypatch.setattr(controller, "_first", lambda *a: max(prepare(*a), BOUNDED))  # it is asked in every step
    monkeypatch.setattr(controller._solver, "solve", stuck)
    statuses = [controller.step(good_state(0.02 * k)).status for k in range(20, 50)]
    assert statuses[0] is Status.DEGRADED
    assert statuses[-1] is Status.FAULT
    assert controller.plan is not None
    assert controller.plan.solver_status == "ITERATION_LIMIT"
    assert not controller.plan.feasible
    assert np.isfinite(controller.plan.states).all()


@settings(max_examples=40, deadline=None)
@given(
    st.floats(-8.0, 8.0), st.floats(-math.pi, math.pi), st.floats(-2.0, 40.0), st.floats(-5.0, 5.0),
    st.floats(-2.0, 2.0), st.floats(-1.0, 1.0), st.floats(-20.0, 220.0),
)  # fmt: skip
def test_any_state_gives_a_finite_command(y, yaw, v_x, v_y, yaw_rate, steer, x):
    controller = SteeringController(BMW, ROAD, DOUBLE)
    for time in (0.0, 0.02):
        command = controller.step(VehicleState(time, x, y, yaw, v_x, v_y, yaw_rate, steer))
        assert math.isfinite(command.steer_angle)
        assert math.isfinite(command.target_speed)
        assert abs(command.steer_angle) <= BMW.steer_limit + 0.01


@pytest.mark.closed_loop
@pytest.mark.parametrize("speed", [2.0, 5.0, 10.0, 20.0, 30.0])
def test_one_tuning_holds_at_every_speed(speed):
    states, _, plans = drive((), start=VehicleState(y=1.0, v_x=speed), duration=8.0)
    offset = np.array([state.y for state in states])
    assert abs(offset[-1]) < 0.03
    assert offset.min() > -0.15  # hardly any overshoot
    assert all(plan.feasible for plan in plans)


@pytest.mark.closed_loop
def test_literal_paper_drives_an_empty_road():
    states, commands, plans = drive((), ControllerConfig.preset("paper"), start=VehicleState(y=0.5, v_x=15.0))
    assert abs(states[-1].y) < 0.05
    assert all(plan.feasible for plan in plans)
    limit = math.atan(BMW.wheelbase * 8.0 / 15.0**2)  # Eq. (14)
    assert max(abs(c.steer_angle) for c in commands) <= limit + 1e-6


@pytest.mark.closed_loop
def test_plan_tells_what_happened():
    _, _, plans = drive(SINGLE, duration=3.0)
    assert {plan.solver_status for plan in plans} == {"UNCONSTRAINED", "SOLVED"}
    plan = next(plan for plan in plans if plan.solver_status == "SOLVED")
    assert plan.iterations > 0
    assert plan.states.shape == (len(plan.states_time), 6)
    assert len(plan.s) == len(plan.l) == len(plan.left) == len(plan.right)
    assert plan.primal_residual < 1e-8
    assert plan.dual_residual < 1e-6  # of gradients around 1e4
    assert plan.step_us >= plan.solve_us > 0.0
    assert plan.sides[0] in (-1, 1)


@pytest.mark.closed_loop
@pytest.mark.parametrize("start", [VehicleState(y=5.0, v_x=10.0), VehicleState(yaw=1.0, v_x=5.0)])
def test_starts_outside_the_corridor_come_back(start):
    states, _, plans = drive((), start=start, duration=15.0)
    assert abs(states[-1].y) < 0.05
    assert abs(states[-1].yaw) < 0.02
    assert plans[-1].feasible


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


@pytest.mark.parametrize("step", [1e-300, 1e-15, 1e-9, 1e-3, 10.0])
def test_any_distance_between_states_is_survived(step):
    controller = SteeringController(BMW, ROAD, SINGLE)
    for k in range(3):
        command = controller.step(replace(good_state(0.0), time=k * step, steer_angle=0.01 * k))
        assert math.isfinite(command.steer_angle)
        assert command.status is Status.TRACKING


@pytest.mark.parametrize("speed", [8.0, -8.0])
def test_a_delay_moves_the_boxes_as_it_moves_the_car(speed):
    """What is planned through a delay is what is planned later without one."""
    box, delay = Obstacle(45.0, 0.6, 4.5, 1.8, speed=speed), 10
    late = SteeringController(BMW, ROAD, [box], ControllerConfig(input_delay_steps=delay, cruise_speed=15.0))
    later = SteeringController(BMW, ROAD, [box], ControllerConfig(cruise_speed=15.0))
    late.step(good_state(0.0))
    later.step(good_state(0.02 * delay))
    assert late.plan is not None
    assert later.plan is not None
    for name in ("s", "l", "left", "right", "states"):
        assert getattr(late.plan, name) == pytest.approx(getattr(later.plan, name), abs=1e-6), name


@pytest.mark.closed_loop
@pytest.mark.parametrize("offset", [0.04, 0.12, 1.0, -2.9])
def test_any_reference_offset_is_reached(offset):
    states, _, plans = drive((), ControllerConfig(reference_offset=offset), start=VehicleState(v_x=12.0))
    assert states[-1].y == pytest.approx(offset, abs=2e-3)
    assert plans[-1].l[-1] == pytest.approx(offset, abs=1e-9)


@pytest.mark.parametrize("offset", [3.0, -3.0])
@pytest.mark.parametrize("radius", [30.0, 50.0])
def test_a_car_beside_the_reference_of_a_bend_is_predicted_where_it_will_be(radius, offset):
    """It stays on its own circle, on which it gets along the reference by v / (1 - kappa l)."""
    speed, road = 8.0, ReferencePath.from_segments([Arc(120.0, 1.0 / radius)])
    config = ControllerConfig(width_left=5.0, width_right=5.0, reference_offset=offset, tyre_model="linear")
    controller, own = SteeringController(BMW, road, [], config), radius - offset
    beta, steer = steady_turn(speed, own)
    x, y = road.to_cartesian(5.0, offset)
    yaw = road.heading(5.0) - beta
    controller.step(VehicleState(0.0, x, y, yaw, speed, speed * beta, speed / own, steer))
    plan = controller.plan
    assert plan is not None
    k = int(np.searchsorted(plan.states_time, 2.0))
    x, y = simulated((x, y, yaw, beta, speed / own), speed, plan.states_time, plan.states[:, 4], plan.states_time[k])
    s, l, _ = road.project(x, y, 5.0)  # noqa: E741
    assert plan.states_s[k] == pytest.approx(s, abs=0.05)
    assert plan.states[k, 0] == pytest.approx(l, abs=0.015)


def simulated(start, speed, times, angles, until):
    """Position of the linear car that steers as predicted, in the plane instead of along a road."""
    a, b, _ = continuous(BMW, speed)

    def rates(t, state):
        _, _, yaw, beta, yaw_rate = state
        turn = a[2:, 2:] @ [beta, yaw_rate] + b[2:] * np.interp(t, times, angles)
        return speed * math.cos(yaw + beta), speed * math.sin(yaw + beta), yaw_rate, *turn

    return solve_ivp(rates, (0.0, until), start, rtol=1e-8, atol=1e-10).y[:2, -1]


def steady_turn(speed, radius):
    """Sideslip and road-wheel angle of the linear car on a circle, in [rad]."""
    a, b, _ = continuous(BMW, speed)
    beta, steer = np.linalg.solve(np.column_stack([a[2:, 2], b[2:]]), -a[2:, 3] * speed / radius)
    return beta, steer


@pytest.mark.parametrize("name", ["x", "y", "yaw", "v_x", "v_y", "yaw_rate", "steer_angle", "time"])
@pytest.mark.parametrize("value", [1e16, -1e16, 1e308])
def test_a_state_that_no_car_has_is_refused(name, value):
    controller = SteeringController(BMW, ROAD, SINGLE)
    controller.step(good_state(0.0))
    command = controller.step(replace(good_state(0.02), **{name: value}))
    assert command.status is Status.DEGRADED
    assert controller.plan is not None
    assert controller.plan.solver_status == "INPUT"
    assert command.target_speed <= 15.0
