"""What one step takes over from the one before."""

import numpy as np

from sidestep.controller import SteeringController
from sidestep.controller.mpc.car_model import Car
from sidestep.controller.mpc.prediction import advance
from sidestep.controller.step import TRUSTED_SLIP
from sidestep.plant_models.road.reference_path import Line, ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
ROAD = ReferencePath.from_segments([Line(200.0)])
CAR = Car.of(BMW, True, 1.0)
SPEED, PARTS, AHEAD = 15.0, 4, 0.8


def worst_yaw_rate_error(plan):
    """Of the prediction against the car's own nonlinear model under the planned wheels, up to AHEAD seconds."""
    x, worst, times = plan.states[0].copy(), 0.0, plan.states_time
    for k in range(1, np.searchsorted(times, AHEAD)):
        step = times[k] - times[k - 1]
        for part in range(PARTS):
            share = (part + 0.5) / PARTS
            angle = (1.0 - share) * plan.states[k - 1, 5] + share * plan.states[k, 5]
            advance(x, np.zeros(2), (SPEED, 0.0), (0.0, 0.0), angle, step / PARTS, CAR, np.empty((6, 6)))
        worst = max(worst, abs(x[3] - plan.states[k, 3]))
    return worst


def test_a_hopeless_prediction_does_not_spoil_the_next_one():
    """A slide that is over, or never was one: forces are taken where the car is now, not where it was to end up."""
    controller = SteeringController(BMW, ROAD)
    controller.step(VehicleState(v_x=SPEED, v_y=-4.0, yaw_rate=1.5))
    assert controller.plan is not None
    assert controller.plan.slack_slip > TRUSTED_SLIP
    controller.step(VehicleState(time=0.06, x=0.9, y=1.0, v_x=SPEED))
    assert controller.plan.slack_slip < 0.01
    assert worst_yaw_rate_error(controller.plan) < 0.05
