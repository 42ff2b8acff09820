"""The MuJoCo plant against Newton, the tyre law and the linear model."""

import ctypes
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, replace

import mujoco
import numpy as np
import pytest

from sidestep.plant_models.checks.check_plant import check_plant
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.bodies import WHEELS, corners
from sidestep.plant_models.mujoco.library import load_own_copy
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.contact import TYRE_MODES, push
from sidestep.plant_models.tyres.formula import magic_formula
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters, vehicle_presets

BMW = VehicleParameters.preset("bmw-320i")
PUBLISHED = BMW.on_tyres(BMW.tyre.without_load_sensitivity())


def drive(plant, state, seconds, steer, speed, dt=0.01):
    """States after every step; `steer` an angle or a function of the time since the start."""
    states = []
    for k in range(round(seconds / dt)):
        angle = steer(k * dt) if callable(steer) else steer
        state = plant.step(SteeringCommand(state.time, angle, speed), dt)
        states.append(state)
    return states


def rows(states):
    return np.array([astuple(state) for state in states])


def by_wheel(signals, quantity):
    return np.array([signals[f"{quantity}_{name}"] for name in WHEELS])


def world_velocity(state):
    c, s = math.cos(state.yaw), math.sin(state.yaw)
    return np.array([c * state.v_x - s * state.v_y, s * state.v_x + c * state.v_y])


@pytest.mark.parametrize(
    "asked",
    [
        VehicleState(),
        VehicleState(3.0, 12.0, -7.0, 2.0, 15.0, 0.3, 0.2, 0.05),
        VehicleState(0.0, -1.0, 1.0, -9.0, 8.0, -0.2, -0.4, -0.3),
    ],
)
def test_reset_puts_the_car_where_it_was_asked(asked):
    got = MujocoPlant(BMW).reset(asked)
    assert astuple(got) == pytest.approx(astuple(asked), abs=1e-12)


def test_reset_cuts_the_steering_angle_to_its_limit():
    assert MujocoPlant(BMW).reset(VehicleState(steer_angle=1.5)).steer_angle == pytest.approx(BMW.steer_limit)


@pytest.mark.parametrize("name", vehicle_presets())
def test_every_preset_stands_on_its_static_loads(name):
    vehicle = VehicleParameters.preset(name)
    with MujocoPlant(vehicle) as plant:
        start = plant.reset(VehicleState(x=1.0, y=2.0, yaw=0.5))
        end = drive(plant, start, 2.0, 0.0, 0.0)[-1]
        assert by_wheel(plant.signals(), "load") == pytest.approx([c.load for c in corners(vehicle)], rel=1e-6)
        assert astuple(end)[1:] == pytest.approx(astuple(start)[1:], abs=1e-6)


@pytest.mark.parametrize("name", vehicle_presets())
def test_every_preset_keeps_the_promises_of_a_plant(name):
    vehicle = VehicleParameters.preset(name)
    assert check_plant(MujocoPlant(vehicle), vehicle) == []


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


def test_the_plant_reads_no_clock_and_leaves_everybody_elses_alone():
    ticks = []

    def clock():
        ticks.append(len(ticks))
        return float(len(ticks))

    mujoco.set_mjcb_time(clock)
    try:
        plant = MujocoPlant(BMW)
        drive(plant, plant.reset(VehicleState(v_x=12.0)), 0.1, 0.05, 12.0)
        assert mujoco.get_mjcb_time() is clock
        assert plant.data.timer[0].duration == 0.0
        before = len(ticks)
        mujoco.mj_step(plant.model, plant.data)
        assert len(ticks) > before
        assert plant.data.timer[0].duration > 0.0
    finally:
        mujoco.set_mjcb_time(None)


def test_the_plants_library_steps_as_the_packages():
    own, theirs = MujocoPlant(BMW), MujocoPlant(BMW)
    for plant in (own, theirs):
        drive(plant, plant.reset(VehicleState(v_x=12.0)), 0.1, 0.05, 12.0)
    step = load_own_copy().mj_step
    step.argtypes, step.restype = [ctypes.c_void_p, ctypes.c_void_p], None
    for _ in range(50):
        step(own.model._address, own.data._address)
        mujoco.mj_step(theirs.model, theirs.data)
    assert own.data.qpos.tobytes() == theirs.data.qpos.tobytes()
    assert own.data.qvel.tobytes() == theirs.data.qvel.tobytes()


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


def test_delayed_steering_does_the_same_later_also_after_a_snapshot():
    late = BMW.with_(suspension=replace(BMW.suspension, steer_delay=0.05))
    plant, twin, start, steer = MujocoPlant(late), MujocoPlant(late), VehicleState(time=3.0, v_x=15.0), [0.0, 0.04]
    prompt, delayed = (
        drive(p, p.reset(start), 0.5, lambda t: steer[t > 0.095], 15.0) for p in (MujocoPlant(BMW), plant)
    )
    shifted = rows(prompt)[:-5, 5:] - rows(delayed)[5:, 5:]  # v_y, yaw rate, angle
    assert np.abs(shifted).max() < 1e-6
    drive(plant, plant.reset(start), 0.1, 0.0, 15.0)
    plant.step(SteeringCommand(0.0, 0.04, 15.0), 0.01)
    twin.restore(plant.save())  # the command is on its way
    assert drive(twin, start, 0.39, 0.04, 15.0) == delayed[11:]
    turning = drive(plant, plant.reset(replace(start, steer_angle=0.04)), 0.05, 0.0, 15.0)
    assert rows(turning)[:, 7] == pytest.approx(0.04, abs=1e-4)


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


def test_halving_the_step_is_of_first_order():
    ends = []
    for time_step in (2e-3, 1e-3, 5e-4, 2.5e-4):
        plant = MujocoPlant(BMW, time_step=time_step)
        end = drive(plant, plant.reset(VehicleState(v_x=15.0)), 2.0, 0.04, 15.0)[-1]
        ends.append([end.x, end.y, end.yaw])
    changes = np.diff(ends, axis=0)
    assert changes[:-1] / changes[1:] == pytest.approx(np.full((2, 3), 2.0), abs=0.02)
    assert np.abs(changes[1]).max() < 0.01


def test_a_step_of_any_length_is_met_exactly():
    plant = MujocoPlant(BMW)
    state = plant.reset(VehicleState(v_x=10.0))
    for dt in (0.01, 0.0037, 1e-4, 1e-12):
        following = plant.step(SteeringCommand(0.0, 0.0, 10.0), dt)
        assert following.time - state.time == pytest.approx(dt, abs=1e-14)
        assert following.x - state.x == pytest.approx(10.0 * dt, abs=1e-9)
        state = following


@pytest.mark.parametrize("tyre", TYRE_MODES)
def test_the_same_bits_after_a_reset_from_a_snapshot_and_beside_another_plant(tyre):
    plant, other = MujocoPlant(BMW, tyre=tyre), MujocoPlant(VehicleParameters.preset("ford-escort"), friction=0.5)
    start, saved = VehicleState(x=1.0, yaw=0.3, v_x=12.0), b""
    first = drive(plant, plant.reset(start), 1.0, 0.1, 9.0)
    again, companion = plant.reset(start), other.reset(start)
    for k, expected in enumerate(first):
        if k == 50:
            saved = plant.save()
        again = plant.step(SteeringCommand(0.0, 0.1, 9.0), 0.01)
        companion = other.step(SteeringCommand(0.0, -0.2, 15.0), 0.01)
        assert again == expected
    assert companion != again
    twin = MujocoPlant(BMW, tyre=tyre)
    for heir in (plant, twin):
        assert heir.restore(saved) == first[49]
        assert drive(heir, again, 0.5, 0.1, 9.0) == first[50:]


def test_what_cannot_be_saved_or_restored_raises():
    plant = MujocoPlant(BMW)
    with pytest.raises(PlantError, match="reset"):
        plant.save()
    other = MujocoPlant(BMW, tyre="contact")
    other.reset(VehicleState())
    with pytest.raises(PlantError, match="another plant"):
        plant.restore(other.save())


def test_threads_give_the_same_bits_as_one_after_the_other():
    def run(steer):
        plant = MujocoPlant(BMW)
        return drive(plant, plant.reset(VehicleState(v_x=15.0)), 1.0, steer, 15.0)

    angles = [0.01, 0.03, -0.02, 0.05]
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(run, angles)) == [run(angle) for angle in angles]


def test_a_wheel_in_the_air_gives_no_force():
    plant = MujocoPlant(BMW)
    plant.reset(VehicleState(v_x=10.0))
    plant.data.qpos[2] += 1.0
    state = plant.step(SteeringCommand(0.0, 0.2, 0.0), 0.1)
    assert not by_wheel(plant.signals(), "load").any()
    assert not plant.data.qfrc_applied.any()
    assert (state.v_x, state.v_y) == pytest.approx((10.0, 0.0), abs=1e-3)
    assert plant.data.subtree_com[1, 2] == pytest.approx(1.0 + BMW.cg_height - GRAVITY * 0.1**2 / 2.0, abs=2e-3)


def test_yaw_goes_on_past_half_a_turn():
    plant = MujocoPlant(BMW)
    start = plant.reset(VehicleState(yaw=3.0, v_x=5.0, steer_angle=0.45))
    yaw = rows(drive(plant, start, 8.0, 0.45, 5.0))[:, 3]
    assert yaw[-1] > 3.0 + 2.0 * math.pi
    assert (np.diff(yaw) > 0.0).all()
    assert np.diff(yaw).max() < 0.02


def test_a_command_that_is_not_a_number_leaves_the_last_one():
    plant, runs = MujocoPlant(BMW), []
    for commands in ([(math.nan, math.inf), (-math.inf, math.nan)], [(0.05, 12.0)] * 2):
        drive(plant, plant.reset(VehicleState(v_x=10.0)), 0.2, 0.05, 12.0)
        runs.append([plant.step(SteeringCommand(0.0, *command), 0.01) for command in commands])
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"friction": 0.0}, "plant.friction"),
        ({"friction": math.nan}, "plant.friction"),
        ({"time_step": 0.0}, "plant.time_step"),
        ({"time_step": 0.1}, "plant.time_step"),
    ],
)
def test_options_out_of_range_are_named(options, where):
    with pytest.raises(InputError) as error:
        MujocoPlant(BMW, **options)
    assert error.value.where == where


def test_a_car_without_suspension_is_refused():
    with pytest.raises(InputError, match=r"^vehicle\.suspension: .*MuJoCo"):
        MujocoPlant(replace(BMW, suspension=None))


def test_what_cannot_be_stepped_raises():
    plant = MujocoPlant(BMW)
    with pytest.raises(PlantError, match="reset"):
        plant.step(SteeringCommand(0.0, 0.0, 0.0), 0.01)
    with pytest.raises(PlantError, match="not finite"):
        plant.reset(VehicleState(v_x=math.nan))
    plant.reset(VehicleState())
    for dt in (0.0, -0.01, math.nan, math.inf):
        with pytest.raises(InputError, match=r"^dt"):
            plant.step(SteeringCommand(0.0, 0.0, 0.0), dt)


def test_a_diverging_simulation_raises_and_stays_quiet(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant = MujocoPlant(BMW)
    plant.reset(VehicleState(v_x=1e9))
    for _ in range(2):
        with pytest.raises(PlantError, match="diverges"):
            plant.step(SteeringCommand(0.0, 0.0, 0.0), 0.01)
    assert capfd.readouterr().err == ""
    assert list(tmp_path.iterdir()) == []
