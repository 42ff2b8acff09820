"""Identification against a car whose parameters are known, and its refusal where the data do not hold them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.catalogue import Manoeuvre, Ramp, RandomSteer
from sidestep.validation.manoeuvres.open_loop import Response, drive
from sidestep.validation.model_error.identification.identification import DRIVES, identify, ljung_box

CAR = VehicleParameters.preset("bmw-320i")
TRUTH = np.array([CAR.cornering_stiffness_front, CAR.cornering_stiffness_rear, CAR.yaw_inertia])
WRONG = CAR.with_(cornering_stiffness_front=90e3, cornering_stiffness_rear=140e3, yaw_inertia=1200.0)
NOISE = {"yaw_rate": 0.001, "lateral_acceleration": 0.025}


@cache
def clean() -> tuple[Response, ...]:
    manoeuvres = [
        replace(m, duration=10.0, lateral_acceleration=3.0, shape=RandomSteer(0.1, 2.0, i))
        for i, m in enumerate(DRIVES[::2])
    ]
    return tuple(drive(LinearPlant(CAR), m, CAR, commands=10) for m in manoeuvres)


def noisy(seed: int) -> list[Response]:
    random = np.random.default_rng(seed)
    return [
        response | {name: response[name] + s * random.standard_normal(len(response[name])) for name, s in NOISE.items()}
        for response in clean()
    ]


def test_without_noise_the_car_is_found_from_far_away():
    found = identify(clean(), WRONG)
    assert found.values == pytest.approx(TRUTH, rel=1e-3)
    assert found.explained == pytest.approx([1.0, 1.0], abs=1e-5)
    vehicle = found.vehicle(WRONG)
    assert vehicle.cornering_stiffness_front == pytest.approx(CAR.cornering_stiffness_front, rel=1e-3)
    assert vehicle.mass == CAR.mass


def test_with_noise_within_a_percent_and_the_intervals_cover_the_truth():
    found = [identify(noisy(seed), CAR) for seed in range(100)]
    errors = np.array([one.values / TRUTH - 1.0 for one in found])
    covered = np.array([(one.intervals[:, 0] <= TRUTH) & (one.intervals[:, 1] >= TRUTH) for one in found])
    assert np.abs(errors).max() < 0.01
    assert (covered.sum(axis=0) >= 90).all()
    assert errors.std(axis=0) == pytest.approx(found[0].deviations, rel=0.3)  # no wider than they need to be
    assert np.mean([one.is_white for one in found]) > 0.8  # two signals, each with a level of 95 %
    assert not any(one.problem for one in found)


def test_yaw_rate_alone_is_refused_though_it_fits():
    found = identify(noisy(0), CAR, signals=("yaw_rate",))
    assert found.explained[0] > 0.99
    assert "cannot be separated: correlation" in found.problem
    with pytest.raises(InputError, match="cannot be separated"):
        found.vehicle(CAR)


def test_steady_turning_does_not_show_the_inertia():
    turn = drive(LinearPlant(CAR), Manoeuvre("turn", Ramp(), 15.0, 0.0, 4.0, bend=2.0), CAR)
    with pytest.raises(InputError, match="never changes"):
        identify([turn | {name: np.full_like(turn[name], 1.0) for name in NOISE}], CAR)
    random = np.random.default_rng(0)
    measured = {name: turn[name] + s * random.standard_normal(len(turn[name])) for name, s in NOISE.items()}
    assert identify([turn | measured], CAR).problem


def test_what_the_model_lacks_shows_in_the_residuals_and_not_in_the_fit():
    """A tyre that relaxes, driven gently: explained to a few per mille, and far from white."""
    with native_plant(CAR) as plant:
        found = identify([drive(plant, m, CAR, commands=2) for m in DRIVES[::2]], WRONG)
    assert not found.problem
    assert (found.explained > 0.99).all()
    assert not found.is_white
    assert (found.ljung_box > 10.0 * found.whiteness_bound).all()


def test_ljung_box_of_white_noise_stays_below_its_bound_in_about_95_of_100():
    random = np.random.default_rng(1)
    white = [ljung_box(random.standard_normal(1000)) for _ in range(200)]
    assert np.mean(np.array(white) <= chi2.ppf(0.95, 50)) == pytest.approx(0.95, abs=0.04)
    assert np.mean(white) == pytest.approx(50.0, rel=0.05)
