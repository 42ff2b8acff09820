"""The table of cars: its form, plausible numbers, a source for each, and that every car drives."""

import csv
import math
from dataclasses import fields

import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.bodies import sprung_body
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.checks import GRAVITY
from sidestep.plant_models.vehicle.library import ESTIMATE, TABLE, library, library_cars
from sidestep.plant_models.vehicle.parameters import AXLES, VehicleParameters, vehicle_presets, vehicle_sources
from sidestep.plant_models.vehicle.suspension import SuspensionParameters

NAMES = library_cars()
CARS = {name: VehicleParameters.preset(name) for name in NAMES}
PLAUSIBLE = {
    "mass": (1000.0, 3300.0), "wheelbase": (2.4, 3.75), "l_f_share": (0.35, 0.55), "track_front": (1.4, 1.8),
    "track_rear": (1.4, 1.8), "length": (3.9, 6.0), "width": (1.65, 2.1), "height": (1.3, 2.0),
    "steering_ratio": (11.0, 20.0), "tyre_factor": (0.35, 1.05),
}  # fmt: skip


def test_there_are_at_least_sixty_and_every_name_is_one_car():
    lines = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert len(rows) == len(NAMES) >= 60
    assert [row["name"] for row in rows] == sorted({row["name"] for row in rows})
    assert not set(NAMES) & set(vehicle_presets())
    assert all(None not in row and all(row.values()) for row in rows)  # every cell of every row


def test_every_number_of_the_table_is_plausible():
    for row in library().values():
        assert row.numbers.keys() == PLAUSIBLE.keys()
        for column, (low, high) in PLAUSIBLE.items():
            assert low <= row.numbers[column] <= high, (row.name, column)
        assert "tyre_factor" in row.estimated  # nobody measured the tyres
        assert max(row.numbers["track_front"], row.numbers["track_rear"]) < row.numbers["width"]
        assert row.numbers["wheelbase"] < 0.75 * row.numbers["length"]


@pytest.mark.parametrize("name", NAMES)
def test_every_number_has_a_source_and_estimates_say_so(name):
    sources = vehicle_sources(name)
    own = {f.name for f in fields(VehicleParameters)} | {f"suspension.{f.name}" for f in fields(SuspensionParameters)}
    assert sources.keys() - own == {"default"}
    public = {key for key, text in sources.items() if not text.startswith("estimated")}
    assert public >= {"mass", "length", "width", "steering_ratio", "suspension.track_front", "suspension.track_rear"}
    assert not public & {"cornering_stiffness_front", "cornering_stiffness_rear", "yaw_inertia", "cg_height", "default"}
    assert ("l_f" in public) == ("l_f_share" not in library()[name].estimated)


@pytest.mark.parametrize("name", NAMES)
def test_every_car_is_one_that_plants_can_build_and_that_drives(name):
    car = CARS[name]
    assert car.suspension
    _, _, (roll, pitch, yaw) = sprung_body(car)
    assert 0.0 < roll < pitch < 1.3 * yaw
    load = {axle: car.axle_load(axle) for axle in AXLES}
    assert sum(load.values()) == pytest.approx(car.mass * GRAVITY)
    gradient = load["front"] / car.cornering_stiffness_front - load["rear"] / car.cornering_stiffness_rear
    assert 0.5 < math.degrees(gradient) < 2.8  # [deg/g], a road car
    springs = sum(car.suspension.roll_of_axle(axle)[0] for axle in AXLES)
    lean = car.mass * GRAVITY * car.cg_height / (springs - car.mass * GRAVITY * car.cg_height)
    assert 4.0 < math.degrees(lean) < 5.5  # per g
    with LinearPlant(car) as plant:
        state = plant.reset(VehicleState(v_x=15.0))
        for k in range(50):
            state = plant.step(SteeringCommand(0.02 * k, 0.02, 15.0), 0.02)
    assert 0.03 < state.yaw_rate < 0.12


def test_the_civic_is_what_the_others_are_scaled_from():
    civic = CARS["honda-civic-2016"]
    assert (civic.cornering_stiffness_front, civic.cornering_stiffness_rear) == (192150.0, 202500.0)
    assert civic.yaw_inertia == pytest.approx(2500.0 * 1326.0 / 1462.0, rel=1e-4)
    assert civic.l_f == pytest.approx(1.08)


def test_inertia_of_the_body_grows_with_its_mass_and_the_square_of_its_size():
    cars = [VehicleParameters.preset(name) for name in library_cars()]
    shares = [(car.suspension, car, 0.5 * (car.suspension.track_front + car.suspension.track_rear)) for car in cars]
    roll = [s.roll_inertia / (car.mass * width**2) for s, car, width in shares]
    pitch = [s.pitch_inertia / (car.mass * car.wheelbase**2) for s, car, _ in shares]
    assert max(roll) == pytest.approx(min(roll), rel=0.01)
    assert max(pitch) == pytest.approx(min(pitch), rel=0.01)


def test_a_name_that_is_none_gets_the_closest():
    with pytest.raises(InputError, match=r"did you mean honda-civic-20\d\d\?; allowed: bmw-320i, ford-escort, vw-"):
        VehicleParameters.preset("honda-civic")
    assert ESTIMATE == "~"


def test_presets_of_their_own_files_say_their_sources_too():
    for name in vehicle_presets():
        sources = vehicle_sources(name)
        assert "CommonRoad vehicle parameter set" in sources["default"]
        assert sources["front_overhang"].startswith("estimated")


def test_sources_name_known_numbers_in_words(tmp_path):
    file = tmp_path / "car.toml"
    for line, problem in (('weight = "scale"', r"vehicle\.source\.weight: unknown key"), ("mass = 3", "3 is not text")):
        file.write_text(f"mass = 1000.0\n[source]\n{line}\n", encoding="utf-8")
        with pytest.raises(InputError, match=problem):
            VehicleParameters.from_file(file)
    file.write_text("source = 1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"vehicle\.source: 1 is not a table"):
        VehicleParameters.from_file(file)
