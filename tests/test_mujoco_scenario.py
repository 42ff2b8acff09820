"""Scenario keys of the MuJoCo car: tyre, tilt, patches."""

import math

import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco_plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand
from sidestep.validation.plants import open_plant
from sidestep.validation.scenario import load_scenario

PATCH = "plant.patches=[{s=20, l=0, length=10, width=8, friction=0.3}]"


def test_tyre_tilt_and_patches_reach_the_plant():
    scenario = load_scenario("moose", ["plant.tyre=contact", "plant.grade=0.1", "plant.bank=-0.05", PATCH])
    with open_plant(scenario) as plant:
        assert isinstance(plant, MujocoPlant)
        state = plant.reset(scenario.start)
        assert plant.model.opt.gravity[:2] / -plant.model.opt.gravity[2] == pytest.approx([-0.1, 0.05])
        grip = []
        while state.x < 28.0:
            state = plant.step(SteeringCommand(state.time, 0.0, scenario.speed), 0.01)
            grip.append((state.x, plant.model.pair_friction[0, 0]))
    low = [x for x, friction in grip if math.isclose(friction, 0.3 * scenario.vehicle.tyre.p_dx1)]
    front = scenario.vehicle.l_f
    assert (low[0] + front, low[-1] + front) == pytest.approx((15.0, 25.0), abs=0.4)


@pytest.mark.parametrize(
    ("override", "where"),
    [
        ("plant.tyre=rubber", "moose: plant.tyre"),
        ("plant.grade=3.0", "plant.grade"),
        ("plant.patches=[{s=20, l=0, length=10, width=8}]", r"moose: plant.patches[0].friction"),
        ("plant.patches=[{s=20, l=0, length=-1, width=8, friction=0.5}]", "moose: plant.patches[0].length"),
    ],
)
def test_bad_values_are_named_by_their_key(override, where):
    with pytest.raises(InputError) as error:
        open_plant(load_scenario("moose", [override]))
    assert error.value.where == where


@pytest.mark.parametrize("override", ["plant.tyre=contact", "plant.grade=0.1", PATCH])
def test_other_plants_know_none_of_it(override):
    with pytest.raises(InputError, match="only with plant mujoco"):
        open_plant(load_scenario("moose", ["plant.kind=linear", override]))
