"""Scenario keys of the MuJoCo car: tyre, tilt, patches."""

import math

import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import load_scenario

BMW = VehicleParameters.preset("bmw-320i")
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


def test_a_file_of_heights_reaches_the_plant_from_the_scenario_s_folder(tmp_path):
    """A kerb of 3 cm under the left wheels: the car stands higher there, and leans with it."""
    heights = np.zeros((17, 121))
    heights[9:, 41:] = 0.03
    np.savetxt(tmp_path / "kerb.csv", heights, delimiter=",", fmt="%g")
    file = tmp_path / "kerb.toml"
    file.write_text(
        """
        name = "kerb"
        speed = 5.0
        duration = 4.0
        road = { width_left = 4.0, width_right = 4.0, segments = [{ type = "line", length = 50.0 }] }
        plant = { heights = { path = "kerb.csv", spacing = 0.5, x = -10.0, y = -4.0 } }
        """
    )
    scenario = load_scenario(file)
    with open_plant(scenario) as plant:
        assert isinstance(plant, MujocoPlant)
        state, rolls = plant.reset(scenario.start), []
        while state.x < 25.0:
            state = plant.step(SteeringCommand(state.time, 0.0, scenario.speed), 0.01)
            rolls.append((state.x, plant.signals()["roll"]))
    before, after = ([roll for x, roll in rolls if a < x < b] for a, b in ((1.0, 8.0), (20.0, 25.0)))
    assert np.mean(before) == pytest.approx(0.0, abs=1e-4)
    with pytest.raises(InputError, match="does not know it; allowed: only with mujoco"):
        open_plant(load_scenario(file, ["plant.kind=linear"]))
    lean = 0.03 / BMW.suspension.track_front  # of the road; the springs give under a body that leans with it
    assert lean < np.mean(after) < 1.25 * lean


@pytest.mark.parametrize(
    ("override", "where"),
    [
        ("plant.tyre=rubber", "plant.tyre"),
        ("plant.grade=3.0", "plant.grade"),
        ("plant.patches=[{s=20, l=0, length=10, width=8}]", r"plant.patches[0].friction"),
        ("plant.heights={spacing=1.0}", "plant.heights.path"),
        ("plant.heights={path='h.csv', spacing=0.0}", "plant.heights.spacing"),
        ("plant.patches=[{s=20, l=0, length=-1, width=8, friction=0.5}]", "plant.patches[0].length"),
    ],
)
def test_bad_values_are_named_by_their_key(override, where):
    with pytest.raises(InputError) as error:
        open_plant(load_scenario("moose", [override]))
    assert error.value.where.removeprefix("moose: ") == where


@pytest.mark.parametrize("override", ["plant.tyre=contact", "plant.grade=0.1", PATCH])
def test_other_plants_know_none_of_it(override):
    with pytest.raises(InputError, match="does not know it; allowed: only with mujoco"):
        open_plant(load_scenario("moose", ["plant.kind=linear", override]))
