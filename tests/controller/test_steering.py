"""The stepping controller: scenes on the linear plant, its limits, and what it corrects."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from scipy.integrate import solve_ivp
from support.steering_drive import BMW, DOUBLE, ROAD, SINGLE, drive, footprint, good_state

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.plant_models.linear.bicycle import continuous
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc
from sidestep.plant_models.signals import Status, VehicleState


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
