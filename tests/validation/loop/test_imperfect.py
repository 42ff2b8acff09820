"""The imperfect car: late, heavier, softer, and measured with noise."""

import numpy as np
import pytest
from support.stand_in import KinematicCar

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.loop.closed_loop import open_controller
from sidestep.validation.loop.measurement import FITTED_NOISE, NOISE, ImperfectMeasurement, measured
from sidestep.validation.loop.plants import ImperfectSteering, open_plant, true_vehicle
from sidestep.validation.scenarios.scenario import load_scenario


def test_a_late_car_does_what_it_was_told_that_much_earlier():
    commands = [SteeringCommand(0.0, 0.01 * k, 10.0 + k) for k in range(20)]
    prompt, late = KinematicCar(), KinematicCar()
    delayed = ImperfectSteering(late, delay=0.05)
    for _ in range(2):  # the second time as the first
        prompt.applied.clear()
        late.applied.clear()
        prompt.reset(VehicleState(v_x=9.0))
        delayed.reset(VehicleState(v_x=9.0, steer_angle=0.3))
        for command in commands:
            prompt.step(command, 0.01)
            delayed.step(command, 0.01)
        told = [(command.steer_angle, command.target_speed) for command in late.applied]
        assert told[:5] == [(0.3, 9.0)] * 5
        assert told[5:] == [(command.steer_angle, command.target_speed) for command in prompt.applied[:15]]


def test_mass_and_stiffness_change_the_car_and_not_what_the_controller_knows():
    scenario = load_scenario("moose", ["plant.kind=linear", "plant.mass=1.2", "plant.stiffness=0.9"])
    known, true = scenario.vehicle, true_vehicle(scenario)
    assert open_controller(scenario).vehicle is known  # pyright: ignore[reportAttributeAccessIssue]
    assert true.mass / known.mass == pytest.approx(1.2)
    assert true.yaw_inertia / known.yaw_inertia == pytest.approx(1.2)
    loaded = true_vehicle(load_scenario("moose", ["plant.kind=linear", "plant.mass=1.2"]))  # tyres under more load
    assert loaded.cornering_stiffness_rear > known.cornering_stiffness_rear
    for name in ("cornering_stiffness_front", "cornering_stiffness_rear"):
        assert getattr(true, name) / getattr(loaded, name) == pytest.approx(0.9)
    with pytest.raises(
        InputError, match=r"plant\.mass: 1\.2: the plant x does not know it; allowed: only with linear, "
    ):
        open_plant(load_scenario("moose", ["plant.kind=x.fmu", "plant.mass=1.2"]))


class Noting:
    """A controller that keeps what it is told."""

    plan = None

    def __init__(self):
        self.states = []

    def reset(self):
        self.states = []

    def step(self, state):
        self.states.append(state)
        return SteeringCommand(state.time, 0.0, 10.0)


def test_noise_has_its_size_its_seed_and_leaves_time_alone():
    inner = Noting()
    scenario = load_scenario("moose", ["plant.noise=2", "plant.measured_offset=0.3"])
    measured = ImperfectMeasurement(inner, scenario.plant)
    true = VehicleState(time=3.0, x=10.0, y=-4.0, yaw=2.0, v_x=8.0)

    def told():
        measured.reset()
        for _ in range(4000):
            measured.step(true)
        return np.array([[getattr(state, name) for name in VehicleState.__slots__] for state in inner.states])

    states = told()
    assert np.array_equal(told(), states)
    expected = np.array([getattr(true, name) for name in VehicleState.__slots__])
    expected[1:3] += 0.3 * np.array([-np.sin(2.0), np.cos(2.0)])  # to the left of the car
    deviation = 2.0 * np.array([getattr(NOISE, name) for name in VehicleState.__slots__])
    assert np.all(np.abs(states.mean(axis=0) - expected) <= 5.0 * deviation / np.sqrt(4000) + 1e-12)
    assert states.std(axis=0) == pytest.approx(deviation, rel=0.05, abs=1e-12)


def test_what_identification_fits_has_noise_of_its_size_and_seed():
    true = {name: np.linspace(0.0, 1.0, 4000) for name in ("steer_angle", "v_y", *FITTED_NOISE)}
    drive = measured(true, 2.0, (7, 1))
    for name, values in drive.items():
        assert np.std(values - true[name]) == pytest.approx(2.0 * FITTED_NOISE.get(name, 0.0), rel=0.05)
    assert np.array_equal(measured(true, 2.0, (7, 1))["yaw_rate"], drive["yaw_rate"])
    assert not np.allclose(measured(true, 2.0, (7, 2))["yaw_rate"], drive["yaw_rate"])
