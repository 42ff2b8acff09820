"""The checks of the MuJoCo car, their table, and what a failing one does."""

import math
from xml.etree import ElementTree

import pytest

from sidestep.plant_models.mujoco.bodies import corners
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.tyres.formula import magic_formula
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.cli.main import main
from sidestep.validation.model_error import validate as module
from sidestep.validation.model_error.mujoco.checks import Check, validate_mujoco
from sidestep.validation.model_error.mujoco.rig import crab


def test_all_fourteen_checks_pass():
    checks = validate_mujoco()
    assert {int(check.name.split()[0]) for check in checks} == set(range(1, 15))
    assert [check.name for check in checks if not check.passed] == []


@pytest.mark.parametrize("on_belt", [False, True])
def test_the_rig_measures_the_formula(on_belt):
    car = VehicleParameters.preset("bmw-320i")
    car = car.on_tyres(car.tyre.without_load_sensitivity())  # the wheels' loads differ a little while led
    plant, load, p = MujocoPlant(car), corners(car)[0].load, car.tyre.as_array()
    angle = math.radians(4.0)
    forces = [crab(plant, speed, angle, on_belt) for speed in (6.0, 20.0)]
    assert forces == pytest.approx([2.0 * magic_formula(0.0, angle, load, 1.0, p)[1]] * 2, rel=1e-3)


def test_a_failing_check_is_shown_and_sets_the_exit_status(monkeypatch, tmp_path, capsys):
    checks = [Check("1 good", 0.1, 0.2, "mm"), Check("2 bad", 0.3, 0.2, ""), Check("3 lost", math.nan, 0.2, "")]
    monkeypatch.setattr(module, "validate_mujoco", lambda: checks)
    monkeypatch.setattr(module, "long_drive", list)
    assert main(["validate", "--checks", "--junit", str(tmp_path / "j.xml")]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[-1] for line in lines if line.split() and line.split()[0] in "123"] == ["PASS", "FAIL", "FAIL"]
    suite = ElementTree.parse(tmp_path / "j.xml").getroot()[0]
    assert [element.get("message") for element in suite.iter("failure")] == ["0.3, limit 0.2", "nan, limit 0.2"]
    monkeypatch.setattr(module, "validate_mujoco", lambda: checks[:1])
    assert main(["validate", "--plant", "mujoco", "--checks"]) == 0


def test_a_plant_without_checks_is_refused(capsys):
    assert main(["validate", "--plant", "linear", "--checks"]) == 2
    assert capsys.readouterr().err == "sidestep: --plant: no checks for 'linear'; allowed: mujoco\n"
