"""What a step answers, beside what it steers."""

import math

import pytest

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.controller.decision.stopping import GRIP_SHARE, LEAST_BRAKING, SWERVE_TIME
from sidestep.controller.speed import CLOSING_TIME
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Line
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
ROAD = ReferencePath.from_segments([Line(200.0)])


@pytest.mark.parametrize(("distance", "friction"), [(9.0, 1.0), (12.0, 1.0), (12.0, 0.5)])
def test_a_car_that_swerves_brakes_with_the_grip_that_is_left(distance, friction):
    """Both together stay within the tyres' circle; where the swerve takes all of it, a little braking is left."""
    box = Obstacle(distance, 0.0, 4.5, 1.8)
    controller = SteeringController(BMW, ROAD, [box], ControllerConfig(friction=friction))
    command, plan = controller.step(VehicleState(v_x=15.0)), controller.plan
    assert plan is not None
    swerve = 15.0 * max(abs(plan.states[plan.states_time <= SWERVE_TIME, 3]))
    braking = (15.0 - command.target_speed) / CLOSING_TIME
    assert swerve > 3.0
    assert braking >= LEAST_BRAKING - 1e-9
    if braking > LEAST_BRAKING + 1e-9:
        assert math.hypot(swerve, braking) == pytest.approx(GRIP_SHARE * friction * GRAVITY, rel=0.02)
