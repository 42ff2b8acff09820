"""The stepping controller's input and solver at their worst: not finite, stale, impossible, failing."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.steering_drive import BMW, DOUBLE, ROAD, SINGLE, good_state

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.controller.answer import SHIFTED_PLAN_TIME
from sidestep.controller.mpc.status import ITERATION_LIMIT
from sidestep.controller.step import BOUNDED, prepare
from sidestep.plant_models.signals import Status, VehicleState


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


@pytest.mark.parametrize("step", [1e-300, 1e-15, 1e-9, 1e-3, 10.0])
def test_any_distance_between_states_is_survived(step):
    controller = SteeringController(BMW, ROAD, SINGLE)
    for k in range(3):
        command = controller.step(replace(good_state(0.0), time=k * step, steer_angle=0.01 * k))
        assert math.isfinite(command.steer_angle)
        assert command.status is Status.TRACKING


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
