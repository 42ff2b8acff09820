"""Handling figures against closed forms of the linear car, and against signals that are made."""

import math

import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.bicycle import continuous
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.bodies import suspension_of
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.catalogue import MANOEUVRES, Manoeuvre, Ramp, RandomSteer, Sine
from sidestep.validation.manoeuvres.frequency_response import frequency_response
from sidestep.validation.manoeuvres.metrics import (
    asymmetry,
    deceleration,
    dwell_response,
    gradients,
    step_response,
    tb_factor,
    weave,
)
from sidestep.validation.manoeuvres.open_loop import drive

UNDERSTEERING = VehicleParameters.preset("bmw-320i", cornering_stiffness_front=100e3, cornering_stiffness_rear=130e3)


def linear(manoeuvre: Manoeuvre):
    return drive(LinearPlant(UNDERSTEERING), manoeuvre, UNDERSTEERING, commands=2)


@pytest.mark.parametrize("name", ["slowly-increasing-steer", "constant-radius"])
def test_gradients_are_those_of_the_linear_car(name):
    car = UNDERSTEERING
    found = gradients(linear(MANOEUVRES[name][0]), car)
    load = car.mass / car.wheelbase
    understeer = load * (car.l_r / car.cornering_stiffness_front - car.l_f / car.cornering_stiffness_rear)
    assert found.understeer == pytest.approx(understeer, rel=0.03)
    rear_slip = -load * car.l_f / car.cornering_stiffness_rear
    if name == "constant-radius":  # l_r / R is constant
        assert found.sideslip == pytest.approx(rear_slip, rel=0.05)
    else:
        assert found.sideslip == pytest.approx(rear_slip + car.l_r / (80.0 / 3.6) ** 2, rel=0.05)
    assert math.isnan(found.roll)


def test_the_mujoco_car_rolls_to_the_outside():
    car = VehicleParameters.preset("bmw-320i")
    manoeuvre = Manoeuvre("ramp", Ramp(0.5, 5.0), 20.0, 5.0, 5.0)
    response = drive(MujocoPlant(car), manoeuvre, car)
    data, stiffness = suspension_of(car), 0.0
    for axle in ("front", "rear"):
        lever = 0.5 * getattr(data, f"track_{axle}") ** 2
        springs = getattr(data, f"spring_{axle}") * lever + getattr(data, f"anti_roll_{axle}")
        stiffness += 1.0 / (1.0 / springs + 1.0 / (data.tyre_stiffness * lever))  # on top of the tyres'
    lean = car.mass * car.cg_height
    assert gradients(response, car).roll == pytest.approx(lean / (stiffness - 9.81 * lean), rel=0.1)


def test_too_gentle_a_drive_has_no_gradients():
    with pytest.raises(InputError, match="lateral accelerations up to 1"):
        gradients(linear(Manoeuvre("ramp", Ramp(0.5, 3.0), 20.0, 1.0, 4.0)), UNDERSTEERING)


def made(values: np.ndarray) -> dict[str, np.ndarray]:
    time = 0.01 * np.arange(len(values))
    return {"time": time, "steer_angle": np.clip((time - 1.0) / 0.2, 0.0, 1.0), "yaw_rate": values}


def test_step_figures_of_a_made_response():
    """Second order with 20 % overshoot: time constants known."""
    time = np.maximum(0.01 * np.arange(1000) - 1.1, 0.0)  # from half of the steering
    damping, omega = 0.4559, 5.0
    omega_d = omega * math.sqrt(1.0 - damping**2)
    values = 1.0 - np.exp(-damping * omega * time) * (
        np.cos(omega_d * time) + damping * omega / omega_d * np.sin(omega_d * time)
    )
    found = step_response(made(3.0 * values))
    assert found.steady == pytest.approx(3.0, rel=1e-4)
    assert found.overshoot == pytest.approx(0.2, abs=2e-3)
    assert found.peak_time == pytest.approx(math.pi / omega_d, abs=0.01)
    assert np.interp(found.response_time, time[110:], values[110:]) == pytest.approx(0.9, abs=1e-3)


def test_step_without_an_answer_is_refused():
    with pytest.raises(InputError, match="ends at 0"):
        step_response(made(np.zeros(400)))


def test_tb_factor_is_peak_time_times_sideslip():
    response = linear(Manoeuvre("step", Ramp(), 25.0, 4.0, 5.0))
    a, b, _ = continuous(UNDERSTEERING, 25.0)
    beta, _ = -np.linalg.solve(a[2:, 2:], b[2:]) * response["steer_angle"][-1]
    assert tb_factor(response) == pytest.approx(step_response(response).peak_time * abs(beta), rel=0.01)


def test_bode_of_the_linear_car_is_its_transfer_function():
    response = linear(Manoeuvre("random", RandomSteer(0.1, 3.0), 20.0, 2.0, 60.0))
    found = frequency_response(response)
    a, b, _ = continuous(UNDERSTEERING, 20.0)
    s = 2j * math.pi * found.frequency
    expected = np.array([np.linalg.solve(p * np.eye(2) - a[2:, 2:], b[2:])[1] for p in s])
    trusted = found.trusted
    assert trusted.mean() > 0.9
    assert found.gain[trusted] == pytest.approx(np.abs(expected)[trusted], rel=0.03)
    assert found.phase[trusted] == pytest.approx(np.unwrap(np.angle(expected))[trusted], abs=0.05)


def test_noise_shows_in_the_coherence():
    response = linear(Manoeuvre("random", RandomSteer(0.1, 3.0), 20.0, 0.5, 60.0))
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(response["time"]))
    noisy = frequency_response(response | {"yaw_rate": response["yaw_rate"] + noise})
    assert noisy.coherence.mean() < frequency_response(response).coherence.mean() - 0.01


def test_weave_finds_gain_and_lag_of_a_made_loop():
    time = 0.01 * np.arange(3000)
    steer, a_y = 0.02 * np.sin(1.2566 * time), 2.0 * np.sin(1.2566 * (time - 0.1))
    found = weave({"time": time, "steer_angle": steer, "lateral_acceleration": a_y})
    assert found.lag == pytest.approx(0.1, abs=3e-3)
    assert found.dead_band == pytest.approx(2.0 * 0.02 * math.sin(0.12566), rel=0.02)
    at_once = weave({"time": time, "steer_angle": steer, "lateral_acceleration": 100.0 * steer})
    assert (at_once.sensitivity, at_once.lag, at_once.dead_band) == pytest.approx((100.0, 0.0, 0.0), abs=1e-6)


def test_dwell_counts_from_the_end_of_the_steering():
    time = 0.01 * np.arange(500)
    steer = Sine(0.7, dwell=0.5)(time)
    end = 0.5 + 1.0 / 0.7 + 0.5
    rate = np.where(time <= end, steer, -0.5 * np.exp(-2.0 * (time - end)))
    rate[np.argmin(steer)] = -1.0
    found = dwell_response({"time": time, "steer_command": steer, "yaw_rate": rate, "y": 2.0 * time})
    assert found.after_1_00 == pytest.approx(0.5 * math.exp(-2.0), rel=0.03)
    assert found.after_1_75 == pytest.approx(0.5 * math.exp(-3.5), rel=0.03)
    assert found.displacement == pytest.approx(2.14, rel=1e-3)


def test_asymmetry_and_deceleration():
    left, right = {"yaw_rate": np.array([0.0, 2.0])}, {"yaw_rate": np.array([0.0, -1.9])}
    assert asymmetry(left, right) == pytest.approx(0.05)
    assert deceleration({"time": np.array([0.0, 4.0]), "v_x": np.array([20.0, 18.0])}) == pytest.approx(0.5)
