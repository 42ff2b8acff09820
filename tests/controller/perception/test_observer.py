"""Disturbance and friction observer: what they must find, and what they must leave alone."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.controller.mpc.car_model import Car, axle_force, peak_slip, slip_angles
from sidestep.controller.mpc.prediction import advance
from sidestep.controller.perception.observer import Disturbance, observe_disturbance, observe_friction, real_forces
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Line
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
CAR = Car.of(BMW, True, 1.0)
PERIOD, SPEED = 0.02, 15.0
STILL = 0.0, 0.0  # no roll


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
            self.x, _ = advance(
                x, STILL, SPEED, 0.0, self.forces, np.array([command.steer_angle + self.angle]), PERIOD, self.car
            )
            offsets.append(x[0])
        return np.array(offsets)


def controller(obstacles=(), **config):
    return SteeringController(BMW, ReferencePath.from_segments([Line(500.0)]), obstacles, ControllerConfig(**config))


def limits(car=CAR):
    return 0.8 * peak_slip(car.load_f, car), 0.8 * peak_slip(car.load_r, car)


def test_real_forces_are_newtons():
    before = np.array([0.0, 0.0, 0.01, 0.1, 0.02, 0.02])
    now, _ = advance(before, STILL, SPEED, 0.0, (500.0, -200.0), np.array([0.02]), 1e-4, CAR)
    front, rear = slip_angles(before[2], before[3], before[4], SPEED, CAR)
    expected = (
        axle_force(front, CAR.stiffness_f, CAR.load_f, CAR) + 500.0,
        axle_force(rear, CAR.stiffness_r, CAR.load_r, CAR) - 200.0,
    )
    assert real_forces(before, now, SPEED, 1e-4, CAR) == pytest.approx(expected, abs=1.0)


@pytest.mark.closed_loop
def test_observer_finds_what_was_put_in():
    car = CAR._replace(relaxation=0.0)  # tyres of `advance` answer at once
    truth, estimate, x = Disturbance(actuator=0.01, sensor=-0.006, share=0.05), Disturbance(), np.zeros(6)
    for k in range(400):
        told = 0.01 * math.sin(0.01 * k)
        before = x.copy()
        command = np.array([told + truth.angle])
        x, _ = advance(x, STILL, SPEED, 0.0, truth.forces(car), command, PERIOD, car)
        shown = [state - truth.sensor * np.eye(6)[4] for state in (before, x)]
        shown[0][5] = told
        estimate = Disturbance(*observe_disturbance(estimate, *shown, STILL, SPEED, PERIOD, car, limits()))
    assert estimate.actuator == pytest.approx(truth.actuator, rel=0.01)
    assert estimate.sensor == pytest.approx(truth.sensor, rel=0.03)
    assert estimate.share == pytest.approx(truth.share, rel=0.03)


@pytest.mark.closed_loop
def test_observer_learns_nothing_from_a_perfect_model():
    estimate, x = Disturbance(), np.zeros(6)
    car = CAR._replace(relaxation=0.0)  # tyres of `advance` answer at once
    for k in range(300):
        command = 0.05 * math.sin(0.1 * k)
        before = x.copy()
        before[5] = command
        x, _ = advance(x, STILL, SPEED, 0.0, (0.0, 0.0), np.array([command]), PERIOD, car)
        estimate = Disturbance(*observe_disturbance(estimate, before, x, STILL, SPEED, PERIOD, car, limits()))
    assert abs(estimate.actuator) < 1e-4
    assert abs(estimate.sensor) < 1e-4
    assert abs(estimate.share) < 1e-3


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


@pytest.mark.closed_loop
def test_friction_bound_falls_when_the_road_gives_less_and_recovers_slowly():
    truth = CAR._replace(friction=0.5)
    car, x, friction = CAR, np.zeros(6), 1.0
    history = []
    for k in range(300):
        command = 0.12 * math.sin(0.06 * k)
        before = x.copy()
        before[5] = command
        x, _ = advance(x, STILL, SPEED, 0.0, (0.0, 0.0), np.array([command]), PERIOD, truth)
        friction = observe_friction(before, x, 0.0, STILL, SPEED, PERIOD, car, limits(car), 1.0)
        car = CAR._replace(friction=friction)
        history.append(friction)
    assert 0.45 < history[-1] < 0.65
    x[:] = 0.0
    assert observe_friction(x, x, 0.0, STILL, SPEED, PERIOD, car, limits(car), 1.0) == pytest.approx(
        friction + 0.01 * PERIOD
    )


@pytest.mark.closed_loop
def test_friction_bound_stays_where_the_model_is_right():
    x, friction = np.zeros(6), 1.0
    for k in range(300):
        before = x.copy()
        before[5] = 0.12 * math.sin(0.06 * k)
        x, _ = advance(x, STILL, SPEED, 0.0, (0.0, 0.0), before[5:], PERIOD, CAR)
        friction = observe_friction(
            before, x, 0.0, STILL, SPEED, PERIOD, CAR._replace(friction=friction), limits(), 1.0
        )
    assert friction > 0.97


@pytest.mark.closed_loop
def test_estimated_friction_reaches_the_prediction():
    slippery = controller((Obstacle(22.0, 0.0, 4.5, 1.8),), estimate_friction=True)  # needs more than the road gives
    World(friction=0.25).drive(slippery, 5.0)
    assert slippery._car.friction < 0.6
    slippery.reset()
    assert slippery._car.friction == 1.0


@pytest.mark.closed_loop
@pytest.mark.parametrize("speed", [3.5, 6.0, 12.0])
def test_noise_is_not_taken_for_a_slippery_road(speed):
    noisy, rng = controller(estimate_friction=True), np.random.default_rng(3)
    for k in range(400):
        v_y, yaw_rate = rng.normal(0.0, [0.02, 0.005])
        noisy.step(VehicleState(k * PERIOD, speed * k * PERIOD, 0.0, 0.0, speed, v_y, yaw_rate))
    assert noisy._car.friction > 0.95


def test_peak_slip_is_the_maximum_of_the_axle_force():
    for friction in (0.3, 1.0):
        car = CAR._replace(friction=friction)
        slip = np.linspace(0.0, 0.5, 5001)
        force = [axle_force(alpha, car.stiffness_f, car.load_f, car) for alpha in slip]
        assert peak_slip(car.load_f, car) == pytest.approx(slip[int(np.argmax(force))], abs=2e-3)


def test_standing_car_is_not_observed():
    still = controller()
    for k in range(20):
        still.step(replace(VehicleState(), time=k * PERIOD, steer_angle=0.01))
    assert still._disturbance == Disturbance()
