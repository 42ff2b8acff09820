"""`sidestep fmu check FILE --map MAP`: what driving an FMU by its mapping finds."""

import sys
from functools import partial

import pytest
from support.fmus.fmu_files import FOREIGN_MAP
from support.fmus.odd_fmus import Odd

from sidestep.fmu.importing.checks import driven_check
from sidestep.fmu.importing.checks.driven_check import check_driven
from sidestep.fmu.importing.isolation import IsolatedPlant
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.plant_models.checks.conventions import clock, determinism, signs
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand, VehicleState

TOLD = '[vehicle]\npreset = "bmw-320i"\n'
RIGHT = FOREIGN_MAP + TOLD


@pytest.fixture
def in_this_process(monkeypatch):
    """As `fmu check` does it, without the second process."""
    monkeypatch.setattr(driven_check, "IsolatedPlant", lambda build, limit: build())


def found_with(foreign, tmp_path, *changes, text=RIGHT):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    table = tmp_path / "map.toml"
    table.write_text(text)
    return check_driven(foreign[0], table)


def test_a_right_mapping_comes_out_clean(foreign, tmp_path, in_this_process):
    assert found_with(foreign, tmp_path) == []


def test_a_mapping_that_tells_no_car_says_what_was_not_compared(foreign, tmp_path, in_this_process):
    [finding] = found_with(foreign, tmp_path, text=FOREIGN_MAP)
    assert finding.startswith("No [vehicle] in the mapping: ratio, reference point")


HAND_WHEEL = 'steer_angle = { variable = "HandWheel", unit = "deg", ratio = 16.0, sign = -1 }'
HAND_WHEEL_NOW = HAND_WHEEL.replace('"HandWheel"', '"HandWheelAngle"')
WRONG = {
    "sign of the steering": ([(HAND_WHEEL, HAND_WHEEL.replace("-1", "1"))], "gives a steer_angle of -0.03, not"),
    "sign of both": (
        [("sign = -1", "sign = 1")], "Steering 0.03 rad to the left gives a yaw_rate of -0.116, not positive.",
    ),
    "sign of the yaw": (
        [('variable = "Psi", unit = "deg"', 'variable = "Psi", unit = "deg", sign = -1')], "a yaw of -0.",
    ),
    "unit of the yaw": ([('variable = "Psi", unit = "deg"', 'variable = "Psi"')], "In a bend x changes by"),
    "unit of the speed": ([('variable = "Car.vx", unit = "km/h"', 'variable = "Car.vx"')], "v_x is 54 instead of 15."),
    "ratio": (
        [("ratio = 16.0", "ratio = 17.6")], "turns 1.1 times as much as its road-wheel angle of 0.1 rad makes it",
    ),
    "ratio of the report alone": (
        [(HAND_WHEEL_NOW, HAND_WHEEL_NOW.replace("16.0", "1.0"))], "steer_angle is 0.48 rad",
    ),
    "reference point": (
        [("estimate", "reference_point = 1.3\nestimate")], "the reference point lies 1.3 m behind",
    ),
    "left and right": ([('y = "Pos.y"', 'y = { variable = "Pos.y", sign = -1 }')], "gives a y of -1."),
    "another car": ([('preset = "bmw-320i"', 'preset = "vw-vanagon"')], "In a slow bend"),
    "another lag": (
        [('preset = "bmw-320i"', 'preset = "bmw-320i"\nsteer_time_constant = 0.3')],
        "steer_angle follows a step of the steering 0.15 s late instead of 0.3 s",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_mapping_is_found(name, foreign, tmp_path, in_this_process):
    changes, expected = WRONG[name]
    found = found_with(foreign, tmp_path, *changes)
    assert any(expected in finding for finding in found), found


def test_the_check_is_made_in_another_process_and_survives_a_crash(tmp_path, monkeypatch):
    module = sys.modules["sidestep.plant_models.checks.check_plant"]
    monkeypatch.setattr(module, "CONVENTIONS", (clock, determinism, signs))
    monkeypatch.setattr(module, "OF_THE_CAR", ())
    table = tmp_path / "map.toml"
    table.write_text(TOLD)
    found = check_driven(Odd(macros=("CRASHES",)).write(tmp_path / "odd.fmu"), table)
    assert any("the plant's process ended in step: SIGABRT" in finding for finding in found), found
    assert len(found) == 4  # every manoeuvre got a process of its own


def test_an_fmu_that_starts_once_per_process_is_driven(tmp_path):
    calls = []

    class Counted(IsolatedPlant):
        def _begin(self):
            calls.append(1)
            super()._begin()

    file = Odd(macros=("ONCE",)).write(tmp_path / "once.fmu")
    with Counted(partial(FmuPlant.from_file, file), 10.0) as plant:
        for speed in (10.0, 12.0):
            assert plant.reset(VehicleState(v_x=speed)).v_x == speed
            plant.step(SteeringCommand(0.0, 0.0, speed), 0.01)
    assert len(calls) == 2


def test_a_vehicle_that_cannot_be_used_is_refused(foreign, tmp_path):
    with pytest.raises(InputError, match=r"unknown preset 'bicycle'"):
        found_with(foreign, tmp_path, ("bmw-320i", "bicycle"))
