"""The MuJoCo plant as a plant: starts, steps, snapshots, threads, and what it refuses."""

import ctypes
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, replace

import mujoco
import numpy as np
import pytest
from support.mujoco_drive import BMW, by_wheel, drive, rows

from sidestep.plant_models.checks.check_plant import check_plant
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco.bodies import corners
from sidestep.plant_models.mujoco.library import load_own_copy
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.contact import TYRE_MODES
from sidestep.plant_models.vehicle.parameters import VehicleParameters, vehicle_presets


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
