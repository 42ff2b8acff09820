import math
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from sidestep.controller.mpc.car_model import Car, axle_force
from sidestep.fmu.description.plants import vehicle_values
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.ranges import bounded_fields
from sidestep.plant_models.tyres.formula import cornering_stiffness
from sidestep.plant_models.vehicle import parameters as module
from sidestep.plant_models.vehicle.parameters import (
    AXLES,
    GRAVITY,
    SuspensionParameters,
    VehicleParameters,
    vehicle_presets,
)

BMW = VehicleParameters.preset("bmw-320i")
CARS = [VehicleParameters.preset(name) for name in vehicle_presets()]
BMW_FILE = Path(module.__file__).parent / "presets" / "bmw-320i.toml"

every_car = pytest.mark.parametrize("car", CARS, ids=lambda car: car.name)


def test_the_papers_car_is_there():
    assert "bmw-320i" in vehicle_presets()
    assert (BMW.name, BMW.wheelbase, BMW.width) == ("bmw-320i", pytest.approx(2.5789), 1.61)


@every_car
def test_cornering_stiffness_is_the_tyres_at_the_static_load(car):
    """The published law: stiffness proportional to load, p_ky1 F_z; two tyres an axle."""
    tyre = car.tyre.without_load_sensitivity().as_array()
    for stiffness, other_arm in ((car.cornering_stiffness_front, car.l_r), (car.cornering_stiffness_rear, car.l_f)):
        wheel_load = 0.5 * car.mass * GRAVITY * other_arm / car.wheelbase
        assert stiffness == pytest.approx(2.0 * cornering_stiffness(wheel_load, tyre), rel=1e-4)


@every_car
def test_loads_and_lengths_add_up(car):
    assert 4.0 * car.tyre.nominal_load == pytest.approx(car.mass * GRAVITY, rel=1e-4)
    assert car.front_extent + car.rear_extent == pytest.approx(car.length)
    assert car.front_overhang + car.wheelbase + car.rear_overhang == pytest.approx(car.length)
    assert car.front_overhang == pytest.approx(car.rear_overhang, abs=1e-3)


@every_car
def test_the_chassis_fits_the_car(car):
    chassis = car.suspension
    unsprung = chassis.unsprung_mass_front + chassis.unsprung_mass_rear
    assert 0.05 * car.mass < unsprung < 0.2 * car.mass
    assert max(chassis.track_front, chassis.track_rear) < car.width
    # A uniform box of this size has a like yaw inertia, and the sprung body rolls more easily than it pitches.
    assert car.yaw_inertia == pytest.approx(car.mass * (car.length**2 + car.width**2) / 12.0, rel=0.4)
    assert chassis.roll_inertia < chassis.pitch_inertia < car.yaw_inertia * 1.2


@every_car
def test_hand_steering_is_slower_than_the_tyres(car):
    assert 0.0 < car.steer_rate_limit < car.steer_limit / car.steer_time_constant


# Overrides and files


def test_overrides_replace_single_values():
    heavy = VehicleParameters.preset("bmw-320i", mass=1300.0)
    assert heavy.mass == 1300.0
    assert BMW.with_(mass=1300.0) == heavy
    light = heavy.with_(mass=BMW.mass)
    assert light.cornering_stiffness_front == pytest.approx(BMW.cornering_stiffness_front)
    assert light.with_(cornering_stiffness_front=1.0, cornering_stiffness_rear=2.0) == BMW.with_(
        cornering_stiffness_front=1.0, cornering_stiffness_rear=2.0
    )  # fmt: skip


def test_a_file_is_read_as_a_preset_is(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_bytes(BMW_FILE.read_bytes())
    mine = VehicleParameters.from_file(file, width=1.7)
    assert mine == BMW.with_(name="mine", width=1.7)


def test_tyre_and_suspension_may_be_left_out(tmp_path):
    file = tmp_path / "plain.toml"
    file.write_text(BMW_FILE.read_text(encoding="utf-8").partition("[tyre]")[0], encoding="utf-8")
    plain = VehicleParameters.from_file(file)
    assert plain.suspension is None
    assert plain.tyre.nominal_load == 4000.0


def test_stiffness_comes_from_one_place(tmp_path):
    text = BMW_FILE.read_text(encoding="utf-8")
    lines = {line.partition(" ")[0]: line + "\n" for line in text.splitlines()[:20] if line[:4] == "corn"}
    file = tmp_path / "car.toml"

    def read(text):
        file.write_text(text, encoding="utf-8")
        return VehicleParameters.from_file(file)

    bare = text.replace(lines["cornering_stiffness_front"], "").replace(lines["cornering_stiffness_rear"], "")
    derived = read(bare)
    assert derived.cornering_stiffness_front == derived.tyre_stiffness("front")
    assert derived.tyre_scale("rear") == 1.0
    with pytest.raises(InputError, match=r"vehicle\.cornering_stiffness_rear: missing; allowed: the stiffness of both"):
        read(text.replace(lines["cornering_stiffness_rear"], ""))
    with pytest.raises(InputError, match=r"vehicle\.tyre\.p_ky1: says how stiff the tyres are, and so does cornering"):
        read(text.replace("[tyre]", "[tyre]\np_ky1 = 20.0"))
    stiffer = read(bare.replace("[tyre]", "[tyre]\np_ky1 = 48.77"))
    assert stiffer.cornering_stiffness_front == pytest.approx(2.0 * derived.cornering_stiffness_front, rel=1e-3)


def test_the_tyres_stay_on_the_car():
    """More load, or a stiffer tyre: the stiffness of an axle follows, its share against the other's stays."""
    stiffer = BMW.with_(tyre=replace(BMW.tyre, p_ky1=1.2 * BMW.tyre.p_ky1))
    assert stiffer.cornering_stiffness_front == pytest.approx(1.2 * BMW.cornering_stiffness_front)
    assert stiffer.tyre_scale("rear") == pytest.approx(BMW.tyre_scale("rear"))
    heavy = BMW.with_(mass=1.1 * BMW.mass)
    assert 1.0 < heavy.cornering_stiffness_rear / BMW.cornering_stiffness_rear < 1.1
    assert BMW.with_(width=1.7).cornering_stiffness_rear == BMW.cornering_stiffness_rear


@every_car
def test_every_model_has_the_stiffness_of_the_file(car):
    """Slope at zero slip of the axle that the controller predicts, linear or not, and of what the FMUs are told."""
    values = vehicle_values(car)
    for axle in AXLES:
        stiffness, load = getattr(car, f"cornering_stiffness_{axle}"), car.axle_load(axle)
        for affine in (True, False):
            model = Car.of(car, affine, 1.0)
            assert axle_force(1e-5, stiffness, load, model) == pytest.approx(1e-5 * stiffness, rel=1e-5)
        tyres = 2.0 * cornering_stiffness(0.5 * load, car.tyre.as_array())
        assert values[f"tyre.scale_{axle}"] * tyres == pytest.approx(stiffness)


def test_published_understeer():
    """CommonRoad's cars have a stiffness proportional to load: neutral, where one load-sensitive tyre understeers."""
    for car in CARS:
        assert 1.0 / car.tyre_scale("front") != pytest.approx(1.0 / car.tyre_scale("rear"), rel=1e-3)
        share_f = car.axle_load("front") / car.cornering_stiffness_front
        assert share_f == pytest.approx(car.axle_load("rear") / car.cornering_stiffness_rear, rel=1e-4)


def test_a_roll_centre_lies_below_the_centre_of_gravity():
    assert BMW.suspension
    with pytest.raises(InputError, match=r"vehicle\.suspension\.roll_centre_rear: not below the centre of gravity"):
        BMW.with_(suspension=replace(BMW.suspension, roll_centre_rear=0.6))


BAD_LINES = [
    ("mass = 1093.2952", "mass = -1", "vehicle.mass", "0.1 to 1e+06 kg"),
    ("mass = 1093.2952", "mass = inf", "vehicle.mass", "0.1 to 1e+06 kg"),
    ("mass = 1093.2952", 'mass = "heavy"', "vehicle.mass", "a number, 0.1 to"),
    ("mass = 1093.2952", "mass = true", "vehicle.mass", "a number, 0.1 to"),
    ("mass = 1093.2952", "wheels = 4", "vehicle.wheels", "mass, yaw_inertia"),
    ("mass = 1093.2952", "", "vehicle", ""),
    ("mass = 1093.2952", "mass = 1.0\nmass = 2.0", "", ""),
    ("length = 4.508", "length = 3.0", "vehicle.length", ">= 3.543"),
    ("steer_limit = 1.066", "steer_limit = 1.6", "vehicle.steer_limit", "0.001 to 1.57 rad"),
    ("steer_time_constant = 0.05", "steer_time_constant = 1.0", "vehicle.steer_time_constant", "0 to 0.99 s"),
    ("[tyre]", "[tyres]", "vehicle.tyres", "tyre, suspension"),
    ("[tyre]\nnominal_load = 2681.3", "tyre = 4", "vehicle.tyre", "nominal_load"),
    ("nominal_load = 2681.3", "nominal_load = 0", "vehicle.tyre.nominal_load", "1 to 1e+06 N"),
    ("nominal_load = 2681.3", "p_dy1 = nan", "vehicle.tyre.p_dy1", ""),
    ("nominal_load = 2681.3", "grip = 1", "vehicle.tyre.grip", "nominal_load"),
    ("track_rear = 1.364", "track_rear = 0", "vehicle.suspension.track_rear", "0.05 to 20 m"),
    ("track_rear = 1.364", "", "vehicle.suspension", ""),
]


@pytest.mark.parametrize(("line", "bad", "where", "allowed"), BAD_LINES)
def test_bad_files_name_file_and_key(tmp_path, line, bad, where, allowed):
    file = tmp_path / "car.toml"
    text = BMW_FILE.read_text(encoding="utf-8")
    assert line in text
    file.write_text(text.replace(line, bad), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        VehicleParameters.from_file(file)
    assert caught.value.where == (f"{file}: {where}" if where else str(file))
    assert allowed in caught.value.allowed


def test_missing_keys_are_named(tmp_path):
    file = tmp_path / "car.toml"
    file.write_text("mass = 1000.0", encoding="utf-8")
    with pytest.raises(InputError, match="missing yaw_inertia, l_f, l_r"):
        VehicleParameters.from_file(file)


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for name in ("missing.toml", "binary.toml"):
        with pytest.raises(InputError, match=name):
            VehicleParameters.from_file(tmp_path / name)


@pytest.mark.parametrize("key", [f.name for f in bounded_fields(VehicleParameters)])
def test_every_number_is_checked(key):
    for value in (-1.0, math.nan, "wide"):
        with pytest.raises(InputError) as caught:
            BMW.with_(**{key: value})
        assert caught.value.where == f"vehicle.{key}"


def test_every_chassis_number_is_checked():
    chassis = tomllib.loads(BMW_FILE.read_text(encoding="utf-8"))["suspension"]
    for key in chassis:
        for value in (-1.0, math.inf, "stiff"):
            with pytest.raises(InputError) as caught:
                SuspensionParameters(**{**chassis, key: value})
            assert caught.value.where == f"vehicle.suspension.{key}"


def test_only_lag_and_anti_roll_bars_may_be_missing_from_a_car():
    assert BMW.with_(steer_time_constant=0.0).steer_time_constant == 0.0
    chassis = tomllib.loads(BMW_FILE.read_text(encoding="utf-8"))["suspension"]
    assert SuspensionParameters(**{**chassis, "anti_roll_front": 0.0, "anti_roll_rear": 0.0}).anti_roll_rear == 0.0
    with pytest.raises(InputError, match=r"vehicle\.suspension\.wheel_radius: 0\.0; allowed: 0\.01 to 5 m"):
        SuspensionParameters(**{**chassis, "wheel_radius": 0.0})


def test_unknown_names():
    with pytest.raises(InputError, match=r"vehicle\.preset: unknown preset 'trabant'; allowed: bmw-320i, "):
        VehicleParameters.preset("trabant")
    for make in (BMW.with_, lambda **values: VehicleParameters.preset("bmw-320i", **values)):
        with pytest.raises(InputError, match=r"vehicle\.weight: unknown key; allowed: name, mass"):
            make(weight=1.0)
