"""Speeds for what lies ahead: arrival at rest, spare grip, and when a tight corridor is a reason to brake."""

import math

import pytest

from sidestep.controller import ControllerConfig
from sidestep.controller.decision.stopping import CREEP_SPEED, approach_speed, spare_braking, squeezed_speed
from sidestep.controller.settings import settings_of
from sidestep.plant_models.speed_control import SPEED_GAIN
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

CONFIG = settings_of(VehicleParameters.preset("bmw-320i"), ControllerConfig())[0]


@pytest.mark.parametrize("distance", [0.5, 5.0, 40.0])
def test_our_speed_control_arrives_within_a_quarter_of_a_metre_without_braking_harder(distance):
    x, v, dt, hardest = 0.0, approach_speed(distance, 0.0, 3.0), 2e-3, 0.0
    for _ in range(15_000):
        acceleration = SPEED_GAIN * (approach_speed(distance - x, 0.0, 3.0) - v)
        hardest = max(hardest, -acceleration)
        v += dt * acceleration
        x += dt * v
    assert x == pytest.approx(distance, abs=0.25)
    assert v == pytest.approx(0.0, abs=1e-6)
    assert hardest <= 3.0


def test_closer_than_wanted_it_falls_back():
    assert approach_speed(-1.0, 8.0, 3.0) == 7.5
    assert approach_speed(-1.0, 0.0, 3.0) == 0.0
    assert approach_speed(0.0, -5.0, 3.0) == 0.0  # oncoming counts as standing


def test_braking_and_swerving_share_the_grip():
    assert spare_braking(0.0, 1.0) == pytest.approx(0.85 * GRAVITY)
    assert math.hypot(spare_braking(6.0, 1.0), 6.0) == pytest.approx(0.85 * GRAVITY)
    assert spare_braking(9.0, 0.6) == 1.0


@pytest.mark.parametrize("room", [40.0, 8.0])
def test_a_quarter_of_the_buffer_is_braked_for(room):
    assert squeezed_speed(0.04, room, False, CONFIG) == math.inf
    assert squeezed_speed(0.06, room, False, CONFIG) == approach_speed(room, 0.0, CONFIG["comfort_braking"])


def test_creeping_on_only_where_the_road_is_free():
    assert squeezed_speed(0.3, -1.0, False, CONFIG) == CREEP_SPEED
    assert squeezed_speed(0.3, -1.0, True, CONFIG) == 0.0
