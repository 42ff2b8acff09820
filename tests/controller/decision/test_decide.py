"""Decisions of one step: what is a reason to slow down, and where to wait."""

import numpy as np
import pytest

from sidestep.controller import SteeringController
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import Line, ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
ROAD = ReferencePath.from_segments([Line(300.0)])


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_car_that_makes_room_does_not_slow_down_for_the_edge_beside_what_comes(mirror):
    """It leans over the edge half a second before they meet: to arrive later would only be met farther out."""
    leaving = VehicleState(y=-2.2 * mirror, yaw=-0.18 * mirror, v_x=15.0)
    oncoming = Obstacle(25.0, 1.0 * mirror, 4.5, 1.8, speed=-10.0)
    alone, met = SteeringController(BMW, ROAD), SteeringController(BMW, ROAD, [oncoming])
    assert alone.step(leaving).target_speed < 15.0
    assert met.step(leaving).target_speed == 15.0
    assert met.plan is not None
    over = np.array([np.abs(row[0] + lever * row[1]) for row in met.plan.states
                     for lever in (BMW.front_extent, -BMW.rear_extent)])  # fmt: skip
    assert over.max() > 4.0 - 0.5 * BMW.width  # over the edge it goes, both times


@pytest.mark.parametrize("distance", [50.0, 60.0])
def test_a_car_that_has_to_stop_does_not_wait_in_the_lane_of_one_far_behind(distance):
    """Overtaken long ago, it will come while the car stands: the place to stand is beside its way."""
    behind, wall = Obstacle(100.0 - distance, 0.0, 4.5, 1.8, speed=4.0), Obstacle(140.0, 0.0, 1.0, 12.0)
    controller = SteeringController(BMW, ROAD, [behind, wall])
    controller.step(VehicleState(x=100.0, v_x=12.0))
    assert controller.plan is not None
    assert abs(controller.plan.l[-1]) > 0.5 * (BMW.width + 1.8)
    alone = SteeringController(BMW, ROAD, [wall])
    alone.step(VehicleState(x=100.0, v_x=12.0))
    assert alone.plan is not None
    assert abs(alone.plan.l[-1]) < 0.1
