"""CommonRoad's multi-body model, the car that three presets name, as a plant: examples/commonroad_plant.py."""

import importlib.util
import sys
from pathlib import Path

import pytest

from sidestep.plant_models.checks.check_plant import check_plant
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.model_error.envelope import cell_errors, cell_manoeuvres

FILE = Path(__file__).parents[3] / "examples" / "commonroad_plant.py"


@pytest.fixture(scope="module")
def make():
    spec = importlib.util.spec_from_file_location("commonroad_plant", FILE)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module.CommonRoadCar
    del sys.modules[spec.name]


def test_it_keeps_the_conventions_of_plants(make):
    car = VehicleParameters.preset("bmw-320i")
    # what is left is about the car: many bodies on other springs, and tyres whose formula ends beyond their peak
    car_itself = ("the front axle slips", "its yaw_inertia over mass", "check of grip ended")
    assert [found for found in check_plant(make(car), car) if not any(part in found for part in car_itself)] == []
    with pytest.raises(InputError, match="'kia-ev6-2022' is no CommonRoad set"):
        make(VehicleParameters.preset("kia-ev6-2022"))


@pytest.mark.closed_loop
@pytest.mark.parametrize("name", ["bmw-320i", "ford-escort"])
def test_both_tyre_models_predict_the_car_that_the_preset_names(make, name):
    """One car: the tangents to the Magic Formula are no worse than the linear tyres where those hold, at 3 m/s^2."""
    car = VehicleParameters.preset(name)
    with make(car) as plant:
        linear, _, affine = cell_errors(plant, car, 1.0, cell_manoeuvres(25.0, 3.0, 0.0)).tolist()
    assert affine < 1.25 * linear
    assert max(linear, affine) < 0.25


def test_it_leans_and_turns_like_the_preset(make):
    """Yaw rate of a gentle turn, within 5 % of the bicycle with the preset's stiffnesses."""
    car = VehicleParameters.preset("bmw-320i")
    with make(car) as plant:
        state = plant.reset(VehicleState(v_x=15.0))
        for k in range(200):
            state = plant.step(SteeringCommand(0.01 * k, 0.02, 15.0), 0.01)
    assert state.yaw_rate == pytest.approx(0.02 * 15.0 / car.wheelbase, rel=0.05)  # neutral
    assert state.y > 0.0
