"""`sidestep vehicles`: lists, shows with sources, compares; and such a car is a preset like any other."""

import math

import pytest

from sidestep.plant_models.vehicle.library import library_cars
from sidestep.plant_models.vehicle.parameters import VehicleParameters, vehicle_presets
from sidestep.validation.cli.main import main
from sidestep.validation.cli.vehicle_tables import characteristic_speed, understeer
from sidestep.validation.scenarios.scenario import load_scenario


def lines(capsys, *arguments):
    assert main(["vehicles", *arguments]) == 0
    return capsys.readouterr().out.splitlines()


def test_the_list_has_every_car_and_marks_estimates(capsys):
    head, *rows, count = lines(capsys)
    assert [row.split()[0] for row in rows] == [*vehicle_presets(), *library_cars()]
    assert count.startswith(f"{len(rows)} cars; ~ estimated")
    assert "understeer [deg/g]" in head
    bmw = next(row.split() for row in rows if row.startswith("bmw-320i"))
    assert bmw[1:] == ["1093", "2.58", "1.38", "-", "130", "105", "0.00"]
    civic = next(row.split() for row in rows if row.startswith("honda-civic-2016"))
    assert civic[1:] == ["1326", "2.70", "1.55", "15.4", "~192", "~202", "~0.86", "2016-2018"]
    assert [row.split()[0] for row in lines(capsys, "--find", "Prius")[1:-1]] == [
        "toyota-prius-2017",
        "toyota-prius-v-2017",
    ]


def test_one_car_is_shown_with_the_source_of_every_number(capsys):
    rows = {row.split()[0]: row.split(maxsplit=2)[1:] for row in lines(capsys, "tesla-model-3-2019")[2:]}
    assert rows["mass"] == ["1899", "opendbc CarSpecs, curb weight (TESLA_MODEL_3)"]
    assert rows["suspension.track_rear"] == ["1.59", "Transport Canada"]
    assert rows["cornering_stiffness_front"][0].startswith("~")
    assert rows["l_f"] == ["~1.4375", "estimated: opendbc's share for the make (TESLA_MODEL_3)"]


def test_cars_are_compared_side_by_side(capsys):
    head, *rows = lines(capsys, "bmw-320i", "kia-ev6-2022")
    assert head.split() == ["bmw-320i", "kia-ev6-2022"]
    table = {row.split()[0]: row.split()[1:] for row in rows}
    assert table["mass"] == ["1093.3", "2055"]
    assert table["steering_ratio"] == ["-", "16"]
    assert table["understeer"] == ["gradient", "[deg/g]", "0.00", "1.36"]


def test_names_that_are_none_are_refused_in_one_line(capsys):
    assert main(["vehicles", "bmw-320i", "trabant"]) == 2
    assert "vehicle.preset: unknown preset 'trabant'" in capsys.readouterr().err
    assert main(["vehicles", "--find", "trabant"]) == 2
    assert main(["vehicles", "bmw-320i", "--find", "bmw"]) == 2


def test_understeer_and_characteristic_speed_are_those_of_the_bicycle():
    """At the characteristic speed the yaw gain is half of what a neutral car has."""
    car = VehicleParameters.preset("honda-cr-v-2017")
    v = characteristic_speed(car)
    c_f, c_r = car.cornering_stiffness_front, car.cornering_stiffness_rear
    gradient = car.mass * (car.l_r * c_r - car.l_f * c_f) / (car.wheelbase * c_f * c_r)
    assert math.radians(understeer(car)) / 9.81 == pytest.approx(gradient, rel=0.01)
    assert v / (car.wheelbase + gradient * v**2) == pytest.approx(0.5 * v / car.wheelbase, rel=0.01)
    assert characteristic_speed(VehicleParameters.preset("bmw-320i")) == math.inf


def test_a_car_of_the_library_is_a_preset_of_scenarios():
    scenario = load_scenario("moose", ["vehicle.preset=mazda-cx-5-2017", "vehicle.mass=1800"])
    assert (scenario.vehicle.name, scenario.vehicle.mass) == ("mazda-cx-5-2017", 1800.0)


def test_a_tyre_file_is_shown_with_what_is_not_used(tmp_path, capsys):
    file = tmp_path / "tyre.tir"
    numbers = "UNLOADED_RADIUS=0.3\nFNOMIN=4000\nPCY1=1.3\nPDY1=0.9\nPKY1=-20\nPKY2=1.6\nQSX1=0.1\n"
    file.write_text(f"[MODEL]\nFITTYP = 6\n[LATERAL_COEFFICIENTS]\n{numbers}", encoding="utf-8")
    rows = lines(capsys, "--tyre", str(file))
    assert rows[0] == f"{file}: Magic Formula 5.2"
    assert rows[-2:] == ["filled in: longitudinal slip: the file has none, the default tyre's", "not used: QSX1"]
    assert [row.split()[-1] for row in rows if row.startswith("  cornering")] == ["71910"]
    assert main(["vehicles", "--tyre", str(file), "bmw-320i"]) == 2
    assert main(["vehicles", "--tyre", str(tmp_path / "none.tir")]) == 2
