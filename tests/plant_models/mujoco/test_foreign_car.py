"""Cars that strangers wrote in MuJoCo's format: what is found in them, and what it drives like."""

import math

import numpy as np
import pytest
from foreign_cars import BARE, CARS, NORTHBOUND, SEDAN, TWO_WHEELED

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco.foreign.car import read_car
from sidestep.plant_models.mujoco.foreign.car_map import CarMap
from sidestep.plant_models.mujoco.foreign.plant import MjcfPlant
from sidestep.plant_models.mujoco.foreign.vehicle import require_speed, vehicle_of
from sidestep.plant_models.mujoco.surface import Surface
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.signals import SteeringCommand, VehicleState

SPEEDS = {"sedan": 15.0, "racer": 3.0, "northbound": 15.0, "backwards": 15.0, "kart": 10.0}
AHEAD = {"sedan": (1, 0), "racer": (1, 0), "northbound": (0, 1), "backwards": (-1, 0), "kart": (1, 0)}
STEERED = {
    "sedan": {"roll_fl", "roll_fr"}, "racer": {"a_t", "b_t"}, "northbound": {"Dreh_1", "Dreh_2"},
    "backwards": {"joint 2", "joint 4"}, "kart": {"fl_roll", "fr_roll"},
}  # fmt: skip
STEERS = {"sedan": "position", "racer": "position", "northbound": "rate", "backwards": "torque", "kart": "position"}
DRIVES = {"sedan": "torque", "racer": "rate", "northbound": "rate", "backwards": "torque", "kart": "torque"}


def written(folder, text):
    file = folder / "car.xml"
    file.write_text(text)
    return file


@pytest.fixture(params=CARS)
def stranger(request, tmp_path):
    return request.param, MjcfPlant(written(tmp_path, CARS[request.param]))


def drive(plant, state, steer, speed, seconds):
    for _ in range(round(seconds / 0.01)):
        state = plant.step(SteeringCommand(state.time, steer, speed), 0.01)
    return state


def test_finds_what_makes_a_car(stranger):
    name, plant = stranger
    car = plant.car
    assert car.forward[:2] == pytest.approx(AHEAD[name], abs=1e-3)
    assert {car.wheels[i].joint for i in car.front} == STEERED[name]
    assert {steer.kind for steer in car.steers} == {STEERS[name]}
    assert {drive.kind for drive in car.drives} == {DRIVES[name]}
    weight = 9.81 * float(plant.model.body_subtreemass[plant.root])
    assert plant.stance.loads.sum() == pytest.approx(weight, rel=0.02)


def test_starts_where_it_is_put(stranger):
    name, plant = stranger
    asked = VehicleState(3.0, 12.0, -7.0, 2.0, SPEEDS[name], 0.1, 0.2, 0.03)
    state = plant.reset(asked)
    for signal in ("time", "x", "y", "yaw", "v_x", "v_y", "yaw_rate"):
        assert getattr(state, signal) == pytest.approx(getattr(asked, signal), abs=1e-9)
    assert state.steer_angle == pytest.approx(0.03, abs=1e-3)
    centre = plant.data.subtree_com[plant.root]
    assert (state.x, state.y) == pytest.approx(tuple(centre[:2]), abs=1e-12)


def test_rolls_from_the_first_step_on(stranger):
    """Wheels that were set wrong would brake or push."""
    name, plant = stranger
    state = plant.reset(VehicleState(v_x=SPEEDS[name]))
    state = drive(plant, state, 0.0, SPEEDS[name], 0.1)
    assert state.v_x == pytest.approx(SPEEDS[name], rel=0.01)


def test_holds_the_speed_and_goes_where_it_steers(stranger):
    name, plant = stranger
    speed, wheelbase = SPEEDS[name], plant.car.wheelbase
    state = drive(plant, plant.reset(VehicleState(v_x=speed)), 0.0, speed, 1.0)
    assert abs(state.y) < 0.02
    steer = 0.5 * wheelbase / speed**2  # half a metre per second squared
    left = drive(plant, plant.reset(VehicleState(v_x=speed)), steer, speed, 3.0)
    right = drive(plant, plant.reset(VehicleState(v_x=speed)), -steer, speed, 3.0)
    assert left.v_x == pytest.approx(speed, rel=0.03)
    assert left.steer_angle == pytest.approx(steer, rel=0.15)
    assert left.yaw_rate == pytest.approx(speed / wheelbase * left.steer_angle, rel=0.15)
    assert right.yaw == pytest.approx(-left.yaw, rel=0.05)


def test_slows_down(stranger):
    name, plant = stranger
    speed = SPEEDS[name]
    state = drive(plant, plant.reset(VehicleState(v_x=speed)), 0.0, 0.7 * speed, 5.0)
    assert state.v_x == pytest.approx(0.7 * speed, rel=0.05)


def test_position_is_the_integral_of_velocity(stranger):
    name, plant = stranger
    speed = SPEEDS[name]
    state = plant.reset(VehicleState(v_x=speed))
    x, y = state.x, state.y
    for _ in range(100):
        before, state = state, plant.step(SteeringCommand(state.time, 0.02, speed), 0.01)
        v_x, v_y, yaw = (0.5 * (getattr(before, n) + getattr(state, n)) for n in ("v_x", "v_y", "yaw"))
        x += 0.01 * (v_x * math.cos(yaw) - v_y * math.sin(yaw))
        y += 0.01 * (v_x * math.sin(yaw) + v_y * math.cos(yaw))
    assert (state.x, state.y) == pytest.approx((x, y), abs=0.01)


def test_same_commands_same_bits(tmp_path):
    plant = MjcfPlant(written(tmp_path, SEDAN))
    ends = [drive(plant, plant.reset(VehicleState(v_x=10.0)), 0.03, 11.0, 0.5) for _ in range(2)]
    assert ends[0] == ends[1]


def test_vehicle_is_that_of_the_model(tmp_path):
    vehicle = vehicle_of(MjcfPlant(written(tmp_path, SEDAN)), 15.0)
    assert vehicle.mass == pytest.approx(1490.0)
    assert vehicle.wheelbase == pytest.approx(2.65, abs=1e-3)
    assert vehicle.length == pytest.approx(4.4, abs=0.02)  # the hull
    assert vehicle.width == pytest.approx(1.74, abs=0.02)  # over the wheels
    body = 1250.0 * (4.4**2 + 1.7**2) / 12.0 + 80.0 * (2.0**2 + 1.5**2) / 12.0
    at_corners = 40.0 * (1.35**2 + 0.76**2) * 2.0 + 40.0 * (1.30**2 + 0.76**2) * 2.0
    assert vehicle.yaw_inertia == pytest.approx(body + at_corners, rel=0.01)  # axle offsets of the masses are small
    load = vehicle.axle_load("front")
    assert 3.0 * load <= vehicle.cornering_stiffness_front <= 100.0 * load


def test_touching_an_obstacle_is_noticed(tmp_path):
    box = Obstacle(s=15.0, l=0.0, length=4.0, width=1.8)
    hits = MjcfPlant(written(tmp_path, SEDAN), obstacles=[box])
    passes = MjcfPlant(written(tmp_path, SEDAN), obstacles=[Obstacle(s=15.0, l=3.0, length=4.0, width=1.8)])
    for plant in (hits, passes):
        drive(plant, plant.reset(VehicleState(v_x=10.0)), 0.0, 10.0, 1.5)
    assert (hits.collided, passes.collided) == (True, False)


def test_ice_is_slippery(tmp_path):
    """Beyond what the road holds, the car on less friction turns less."""
    rates = []
    for friction in (1.0, 0.2):
        plant = MjcfPlant(written(tmp_path, SEDAN), friction=friction)
        rates.append(drive(plant, plant.reset(VehicleState(v_x=15.0)), 0.06, 15.0, 1.5).yaw_rate)
    assert rates[1] <= 0.25 * 9.81 / 15.0 < rates[0]


def test_a_grade_does_not_slow_the_car(tmp_path):
    plant = MjcfPlant(written(tmp_path, SEDAN), surface=Surface(grade=0.05))
    state = drive(plant, plant.reset(VehicleState(v_x=10.0)), 0.0, 10.0, 3.0)
    assert state.v_x == pytest.approx(10.0, abs=0.3)


def test_says_what_was_changed(tmp_path):
    notes = "\n".join(MjcfPlant(written(tmp_path, BARE)).notes)
    assert "'kart' was fixed to the world" in notes
    assert "'fl_turn', 'fr_turn' got servos" in notes
    assert "'rl_roll', 'rr_roll' got motors" in notes
    assert "does not touch 'Mauer'" in "\n".join(MjcfPlant(written(tmp_path, NORTHBOUND)).notes)


def test_mapping_file_decides(tmp_path):
    told = tmp_path / "car.toml"
    told.write_text(
        'steering = ["steer_left", "steer_right"]\ndrive = "drive_left"\nchassis = "base_link"\nforward = "x"\n'
    )
    car = read_car(written(tmp_path, SEDAN), CarMap.from_file(told))
    assert [drive.name for drive in car.drives] == ["drive_left"]


def refused(folder, text, told=None):
    with pytest.raises((InputError, PlantError)) as error:
        MjcfPlant(written(folder, text), told)
    return str(error.value)


def test_what_is_no_car_is_named(tmp_path):
    message = refused(tmp_path, TWO_WHEELED)
    assert "2 wheels found on 'car' (left, right)" in message
    assert "at least three" in message


def test_what_does_not_steer_is_named(tmp_path):
    fixed = SEDAN.replace('<joint name="steer_fl" class="kingpin"/>', "").replace(
        '<joint name="steer_fr" class="kingpin"/>', ""
    )
    start = fixed.index('    <position name="steer_left"')
    fixed = fixed[:start] + fixed[fixed.index('    <motor name="drive_left"') :]
    message = refused(tmp_path, fixed)
    assert "nothing steers" in message
    assert "'drive_left' spins 'roll_rl'" in message


def test_wrong_names_get_the_right_ones(tmp_path):
    assert "did you mean steer_left?" in refused(tmp_path, SEDAN, CarMap(steering=("steer_lef",)))
    assert "'drive_left' steers no wheel" in refused(tmp_path, SEDAN, CarMap(steering=("drive_left",)))
    assert "push no wheel ahead" in refused(tmp_path, SEDAN, CarMap(drive=("steer_left",)))
    assert "no body 'chasis'" in refused(tmp_path, SEDAN, CarMap(chassis="chasis"))
    assert "not ahead of the others" in refused(tmp_path, SEDAN, CarMap(forward="-x"))
    assert "the axles point along it" in refused(tmp_path, SEDAN, CarMap(forward="y"))


def test_broken_files_are_refused(tmp_path):
    assert "MuJoCo does not take it" in refused(tmp_path, "<mujoco><worldbody><body></worldbody></mujoco>")
    with pytest.raises(InputError, match="no file"):
        read_car(tmp_path / "nowhere.xml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('chasis = "a"', "did you mean chassis"), ('forward = "north"', "x, -x, y"), ("wheels = 3", "list of names"),
        ("hold = { a = true }", "finite number"), ("chassis = 1", "a name"), ("=", "car.toml"),
    ],
)  # fmt: skip
def test_mapping_file_is_checked(tmp_path, text, message):
    file = tmp_path / "car.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        CarMap.from_file(file)


def test_a_speed_out_of_reach_is_told_plainly(tmp_path):
    plant = MjcfPlant(written(tmp_path, CARS["racer"]))
    with pytest.raises(InputError, match="speed: 15 m/s: told to hold that straight on, the car of racer ends up at"):
        require_speed(plant, 15.0, "racer")


def test_commands_that_are_no_numbers_are_ignored(tmp_path):
    plant = MjcfPlant(written(tmp_path, SEDAN))
    plant.reset(VehicleState(v_x=10.0))
    assert plant.step(SteeringCommand(0.0, math.nan, math.inf), 0.01).is_finite()
    with pytest.raises(InputError, match="dt"):
        plant.step(SteeringCommand(0.0, 0.0, 10.0), -1.0)
    with pytest.raises(PlantError, match="not finite"):
        plant.reset(VehicleState(x=np.nan))
