"""Disturbance observer: what they must find, and what they must leave alone."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.controller.mpc.car_model import Car, axle_force, peak_slip, slip_angles
from sidestep.controller.mpc.prediction import advance
from sidestep.controller.perception.observer import observe_disturbance, real_forces
from sidestep.controller.records import DISTURBANCE, record
from sidestep.controller.settings import settings_of
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import Line, ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
CAR = Car.of(BMW, True, 1.0)
PERIOD, SPEED = 0.02, 15.0


class World:
    """The controller's own nonlinear model with something that it does not know about."""

    def __init__(self, forces=(0.0, 0.0), angle=0.0, friction=1.0, offset=0.0):
        self.forces, self.angle, self.car = forces, angle, CAR._replace(friction=friction)
        self.x, self.y, self.state = np.array([offset, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.0, None

    def drive(self, controller, seconds):
        offsets = []
        for k in range(round(seconds / PERIOD)):
            x = self.x
            state = VehicleState(k * PERIOD, SPEED * k * PERIOD, x[0], x[1], SPEED, x[2] * SPEED, x[3], x[4])
            command = controller.step(state)
            offsets.append(x[0])
            angle = command.steer_angle + self.angle
            advance(x, np.zeros(2), (SPEED, 0.0), self.forces, angle, PERIOD, self.car, np.empty((6, 6)))
        return np.array(offsets)


def controller(obstacles=(), **config):
    return SteeringController(BMW, ReferencePath.from_segments([Line(500.0)]), obstacles, ControllerConfig(**config))


def test_real_forces_are_newtons():
    before = np.array([0.0, 0.0, 0.01, 0.1, 0.02, 0.02])
    now = before.copy()
    advance(now, np.zeros(2), (SPEED, 0.0), (500.0, -200.0), 0.02, 1e-4, CAR, np.empty((6, 6)))
    front, rear = slip_angles(before[2], before[3], before[4], SPEED, CAR)
    expected = (
        axle_force(front, CAR.stiffness_f, CAR.load_f, CAR) + 500.0,
        axle_force(rear, CAR.stiffness_r, CAR.load_r, CAR) - 200.0,
    )
    assert real_forces(before, now, SPEED, 1e-4, CAR) == pytest.approx(expected, abs=1.0)


def learned(truth, commands):
    """Estimate after a drive whose wheels stand off and are pushed by what the model does not know."""
    config = ControllerConfig(tyre_model="affine")
    settings, estimate, x = settings_of(BMW, config), record(DISTURBANCE), np.zeros(6)
    settings["car"]["relaxation"] = 0.0  # tyres of `advance` answer at once
    car = CAR._replace(relaxation=0.0)
    actuator, sensor, share = truth
    for told in commands:
        before = x.copy()
        forces = share * car.load_f, share * car.load_r
        advance(x, np.zeros(2), (SPEED, 0.0), forces, told + actuator + sensor, PERIOD, car, np.empty((6, 6)))
        shown = [state - sensor * np.eye(6)[4] for state in (before, x)]
        shown[0][5] = told
        observe_disturbance(estimate[0], *shown, np.zeros(2), SPEED, PERIOD, settings[0])
    return [float(estimate[name][0]) for name in ("actuator", "sensor", "share")]


@pytest.mark.closed_loop
def test_observer_finds_what_was_put_in():
    truth = (0.01, -0.006, 0.05)
    found = learned(truth, [0.01 * math.sin(0.01 * k) for k in range(400)])
    assert found[0] == pytest.approx(truth[0], rel=0.01)
    assert found[1:] == pytest.approx(truth[1:], rel=0.03)


@pytest.mark.closed_loop
def test_observer_learns_nothing_from_a_perfect_model():
    actuator, sensor, share = learned((0.0, 0.0, 0.0), [0.05 * math.sin(0.1 * k) for k in range(300)])
    assert abs(actuator) < 1e-4
    assert abs(sensor) < 1e-4
    assert abs(share) < 1e-3


@pytest.mark.closed_loop
@pytest.mark.parametrize(
    "world",
    [{"angle": math.radians(1.0)}, {"forces": (300.0, 300.0)}, {"forces": (0.04 * CAR.load_f, 0.04 * CAR.load_r)}],
    ids=["steering offset", "side wind", "bank"],
)
def test_steady_error_goes_and_stays_without_the_observer(world):
    with_it = World(**world).drive(controller(), 8.0)
    without = World(**world).drive(controller(reject_disturbance=False), 8.0)
    assert abs(with_it[-1]) < 0.005
    assert abs(without[-1]) > 0.02


@pytest.mark.closed_loop
def test_transients_are_not_spoiled():
    scene = (Obstacle(40.0, 0.0, 4.5, 1.8),)
    with_it = World().drive(controller(scene), 8.0)
    without = World().drive(controller(scene, reject_disturbance=False), 8.0)
    assert np.abs(with_it - without).max() < 0.02


def test_peak_slip_is_the_maximum_of_the_axle_force():
    for friction in (0.3, 1.0):
        car = CAR._replace(friction=friction)
        slip = np.linspace(0.0, 0.5, 5001)
        force = [axle_force(alpha, car.stiffness_f, car.load_f, car) for alpha in slip]
        assert peak_slip(car.stiffness_f, car.load_f, car) == pytest.approx(slip[int(np.argmax(force))], abs=2e-3)


def test_standing_car_is_not_observed():
    still = controller()
    for k in range(20):
        still.step(replace(VehicleState(), time=k * PERIOD, steer_angle=0.01))
    assert still._memory["disturbance"].tolist() == [(0.0, 0.0, 0.0, 0.0)]


def test_wheels_that_are_still_on_their_way_are_no_offset():
    """A command that jumps farther than the actuator can follow: what lacks for now is its speed, not its angle."""
    jump = 0.1
    on_the_way = int(0.8 * jump / (BMW.steer_rate_limit * PERIOD))
    assert on_the_way > 5
    assert abs(learned((0.0, 0.0, 0.0), 50 * [0.0] + on_the_way * [jump])[0]) < 5e-4
