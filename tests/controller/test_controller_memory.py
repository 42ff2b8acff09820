"""Saving and restoring the controller: the rest of a drive is the same to the last bit."""

from dataclasses import replace

import pytest

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import Line, ReferencePath
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

CAR = VehicleParameters.preset("bmw-320i")


def controller(**settings):
    road, box = ReferencePath.from_segments([Line(150.0)]), Obstacle(30.0, 0.3, 4.5, 1.8)
    return SteeringController(CAR, road, [box], ControllerConfig(**settings))


def states(count=60):
    driver, plant = controller(), LinearPlant(CAR)
    state = plant.reset(VehicleState(y=0.4, v_x=15.0))
    for _ in range(count):
        yield state
        state = plant.step(driver.step(state), 0.02)


@pytest.mark.parametrize(
    "settings",
    [{}, {"input_delay_steps": 1, "body_roll": True}, {"formulation": "paper"}],
    ids=["default", "delayed", "paper"],
)
def test_restored_controller_goes_on_to_the_last_bit(settings):
    original, other = controller(**settings), controller(**settings)
    drive = list(states())
    for state in drive[:25]:
        original.step(state)
    memory = original.save()
    expected: list[SteeringCommand] = [original.step(state) for state in drive[25:]]
    other.step(replace(drive[3], y=-1.0))
    for restored in (other, original):
        restored.restore(memory)
        assert [restored.step(state) for state in drive[25:]] == expected


def test_settings_hold_from_the_restore_on():
    original, wary = controller(cruise_speed=15.0), controller(cruise_speed=12.0, buffer=0.6)
    drive = list(states(30))
    for state in drive[:25]:
        original.step(state)
    wary.restore(original.save())
    assert wary.step(drive[25]).target_speed == 12.0
    assert original.step(drive[25]).target_speed == 15.0
    assert wary.step(drive[26]).steer_angle != original.step(drive[26]).steer_angle
