"""The MuJoCo plant against Newton, the tyre law and the linear model."""

import math

import mujoco
import numpy as np
import pytest
from support.mujoco_drive import BMW, PUBLISHED, by_wheel, drive, rows, world_velocity

from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.bodies import WHEELS, corners
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.contact import push
from sidestep.plant_models.tyres.formula import magic_formula
from sidestep.plant_models.vehicle.parameters import GRAVITY


@pytest.mark.parametrize("speed", [5.0, 15.0, 30.0])
def test_axle_stiffness_of_the_moving_car_is_the_formula_s_at_any_speed(speed):
    """Axle forces from Newton's law in a steady bend of 0.5 m/s^2, slip angles from the planar motion."""
    plant = MujocoPlant(PUBLISHED)
    s = drive(plant, plant.reset(VehicleState(v_x=speed)), 6.0, 0.5 * BMW.wheelbase / speed**2, speed)[-1]
    force = BMW.mass * s.v_x * s.yaw_rate / BMW.wheelbase
    front_slip = s.steer_angle - math.atan2(s.v_y + BMW.l_f * s.yaw_rate, s.v_x)
    rear_slip = math.atan2(BMW.l_r * s.yaw_rate - s.v_y, s.v_x)
    p, stations = PUBLISHED.tyre.as_array(), corners(BMW)
    front, rear = force * BMW.l_r / math.cos(s.steer_angle), force * BMW.l_f
    for got, slip, station in ((front, front_slip, stations[0]), (rear, rear_slip, stations[2])):
        formula = 2.0 * magic_formula(0.0, slip, station.load, 1.0, p)[1]
        assert got == pytest.approx(formula, rel=1e-3)


def test_newton_balance():
    """The momentum changes by the shear forces alone, in the steps of a swerve."""
    plant = MujocoPlant(BMW)
    state = drive(plant, plant.reset(VehicleState(v_x=15.0)), 0.5, 0.05, 15.0)[-1]
    errors, forces = [], []
    for k in range(500):
        command = SteeringCommand(state.time, 0.05 * math.cos(0.008 * k), 14.0)
        before, state = world_velocity(state), plant.step(command, 1e-3)
        forces.append(plant.data.qfrc_applied[:2].copy())
        errors.append(BMW.mass * (world_velocity(state) - before) / 1e-3 - forces[-1])
    assert np.abs(errors).max() <= 1e-5 * np.abs(forces).max()


def test_a_wrench_on_a_wheel_reaches_the_joints_as_by_mujocos_jacobian():
    plant = MujocoPlant(BMW)
    drive(plant, plant.reset(VehicleState(v_x=12.0, yaw=2.0)), 1.3, 0.08, 5.0)  # rolls, pitches, is on the turn
    model, data = plant.model, plant.data
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    force, torque = np.array([300.0, -2000.0, 90.0]), np.array([40.0, 25.0, -60.0])
    for i, wheel in enumerate(plant._car[0]["wheel"]):
        got, expected = np.zeros(model.nv), np.zeros(model.nv)
        push(i, plant._car[0], data.xipos, data.xmat, data.qpos, got, tuple(force), tuple(torque))
        mujoco.mj_applyFT(model, data, force, torque, data.xipos[wheel], wheel, expected)
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-9)


def test_roll_moment_balance():
    """In a steady bend the wheel loads carry the centrifugal moment about the road and turn the wheels' spin."""
    plant = MujocoPlant(BMW)
    drive(plant, plant.reset(VehicleState(v_x=15.0)), 6.0, 0.04, 15.0)
    signals, data = plant.signals(), plant.data
    state = plant.step(SteeringCommand(0.0, 0.04, 15.0), 1e-3)
    left = np.array([-math.sin(state.yaw), math.cos(state.yaw)])
    centre = data.subtree_com[1]
    patches = data.sensordata[:56].reshape(4, 14)[:, 2:4]
    loads = by_wheel(plant.signals(), "load")
    side = loads @ ((patches - centre[:2]) @ left)
    spin = sum(data.qvel[plant.model.joint(f"spin_{name}").dofadr[0]] for name in WHEELS)
    gyroscopic = BMW.suspension.wheel_spin_inertia * spin * state.yaw_rate
    assert side == pytest.approx(-BMW.mass * signals["a_y"] * centre[2] - gyroscopic, rel=2e-3)
    assert loads.sum() == pytest.approx(BMW.mass * GRAVITY, rel=1e-3)
    assert signals["a_y"] == pytest.approx(state.v_x * state.yaw_rate, rel=1e-3)
    assert signals["roll"] > 0.02  # to the right in a left bend
    assert (by_wheel(signals, "slip_angle") > 0.0).all()


def test_left_and_right_are_mirror_images():
    plant = MujocoPlant(BMW)
    left, right = (rows(drive(plant, plant.reset(VehicleState(v_x=15.0)), 2.0, a, 12.0)) for a in (0.05, -0.05))
    assert np.abs(left - right * [1, 1, -1, -1, 1, -1, -1, -1]).max() < 1e-9


@pytest.mark.parametrize("speed", [8.0, 15.0, 25.0])
def test_steady_yaw_rate_is_the_neutral_bicycle_s(speed):
    plant, steer = MujocoPlant(PUBLISHED), 0.5 * BMW.wheelbase / speed**2
    end = drive(plant, plant.reset(VehicleState(v_x=speed)), 6.0, steer, speed)[-1]
    assert end.yaw_rate == pytest.approx(end.v_x * steer / BMW.wheelbase, rel=5e-3)


@pytest.mark.parametrize(("speed", "degrees"), [(15.0, 0.5), (15.0, 2.0), (25.0, 1.0)])
def test_step_steer_against_the_linear_single_track(speed, degrees):
    """Same published tyre, same actuator: peak within 6 %, the transient within relaxation and roll."""
    runs = []
    for plant in (MujocoPlant(PUBLISHED), LinearPlant(PUBLISHED)):
        runs.append(rows(drive(plant, plant.reset(VehicleState(v_x=speed)), 3.0, math.radians(degrees), speed)))
    (yaw_rate, steer), (linear_rate, linear_steer) = (run[:, [6, 7]].T for run in runs)
    assert yaw_rate.max() == pytest.approx(linear_rate.max(), rel=0.06)
    assert yaw_rate[-1] == pytest.approx(linear_rate[-1], rel=0.02)
    assert np.abs(yaw_rate - linear_rate).max() < 0.1 * linear_rate.max()
    assert np.abs(steer - linear_steer).max() < 1e-4


def test_brakes_bring_it_to_a_lasting_standstill():
    plant = MujocoPlant(BMW)
    start = plant.reset(VehicleState(v_x=20.0))
    states = drive(plant, start, 8.0, 0.0, 0.0)
    run = rows(states)
    assert 20.0**2 / 2.0 / BMW.max_braking < run[-1, 1] < 1.1 * 20.0**2 / 2.0 / BMW.max_braking + 2.5
    assert run[:, 4].min() > -0.05  # it rocks on its tyres, no more
    assert np.abs(run[-200:, 1] - run[-1, 1]).max() < 1e-3
    assert abs(run[-1, 4]) < 1e-3
    assert np.abs(run[:, [2, 3, 5, 6]]).max() < 1e-9
    spin = [plant.model.joint(f"spin_{name}").dofadr[0] for name in WHEELS]
    assert np.abs(plant.data.qvel[spin]).max() < 1e-3
    moving = drive(plant, states[-1], 3.0, 0.0, 5.0)[-1]
    assert moving.v_x == pytest.approx(5.0, abs=0.05)


def test_low_friction_lengthens_braking_and_bends():
    """Friction 0.3 allows 0.3 g times the tyre's peak; the wheels do not lock."""
    plant = MujocoPlant(BMW, friction=0.3)
    state, slips, distance = plant.reset(VehicleState(v_x=15.0)), [], 0.0
    while state.v_x > 3.0:
        state = plant.step(SteeringCommand(state.time, 0.0, 0.0), 0.01)
        slips.append(by_wheel(plant.signals(), "slip_ratio").min())
        distance = state.x
    deceleration = (15.0**2 - state.v_x**2) / 2.0 / distance
    assert 0.8 * 0.3 * GRAVITY < deceleration < 1.2 * 0.3 * GRAVITY
    assert min(slips) > -0.1
    turning, gentle = plant.reset(VehicleState(v_x=15.0)), []
    for _ in range(300):
        turning = plant.step(SteeringCommand(turning.time, 0.3, 15.0), 0.01)
        gentle.append(plant.signals()["a_y"])
    assert 0.8 * 0.3 * GRAVITY < max(gentle) < 1.1 * 0.3 * GRAVITY
    assert turning.yaw_rate < 0.5 * turning.v_x * 0.3 / BMW.wheelbase  # it ploughs


def test_a_sideways_slide_ends_where_friction_stops_it():
    plant = MujocoPlant(BMW, friction=0.5)
    run = rows(drive(plant, plant.reset(VehicleState(v_y=5.0)), 4.0, 0.0, 0.0))
    assert run[-1, 2] == pytest.approx(5.0**2 / 2.0 / (0.5 * BMW.tyre.p_dy1 * GRAVITY), rel=0.15)
    assert run[:, 5].min() > -0.5  # the tyres spring back, they do not throw the car
    assert np.abs(run[-1, [4, 5, 6]]).max() < 0.02


def test_a_wheel_in_the_air_gives_no_force():
    plant = MujocoPlant(BMW)
    plant.reset(VehicleState(v_x=10.0))
    plant.data.qpos[2] += 1.0
    state = plant.step(SteeringCommand(0.0, 0.2, 0.0), 0.1)
    assert not by_wheel(plant.signals(), "load").any()
    assert not plant.data.qfrc_applied.any()
    assert (state.v_x, state.v_y) == pytest.approx((10.0, 0.0), abs=1e-3)
    assert plant.data.subtree_com[1, 2] == pytest.approx(1.0 + BMW.cg_height - GRAVITY * 0.1**2 / 2.0, abs=2e-3)
