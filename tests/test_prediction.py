"""The prediction model against scipy's matrix exponential and the paper's equations."""

import numpy as np
import pytest
from scipy.linalg import expm

from sidestep.controller.prediction import (
    COARSEST_STEP,
    HORIZON,
    SLOWEST,
    advance,
    exponential,
    grid,
    model_block,
    model_parameters,
    stage_matrices,
    steady_gain,
)
from sidestep.plant_models.bicycle import continuous, discretise
from sidestep.plant_models.vehicle import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
CAR = model_parameters(BMW)


@pytest.mark.parametrize("speed", [0.0, 2.0, 15.0, 35.0])
@pytest.mark.parametrize("dt", [0.01, 0.02, 0.16])
def test_exponential_is_that_of_scipy(speed, dt):
    block = model_block(speed, CAR)
    assert exponential(block, dt) == pytest.approx(expm(block * dt), abs=1e-9)


def test_levels_are_powers_of_the_first():
    block = model_block(15.0, CAR)
    for i, stage in enumerate(stage_matrices(15.0, CAR, 0.02, 4)):
        assert stage == pytest.approx(expm(block * 0.02 * 2**i), abs=1e-9)


def test_model_is_equation_5():
    a, b, _ = continuous(BMW, 15.0)
    block = model_block(15.0, CAR)
    assert block[:4, :4] == pytest.approx(a)
    assert block[:4, 4] == pytest.approx(b)
    assert block[1, 7] == -1.0  # -v kappa enters as the road's turn rate


@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_advance_holds_each_command_for_a_period(lag):
    car = CAR.copy()
    car[6] = lag
    start = np.array([0.3, 0.02, 0.01, 0.1, 0.03, 0.03])
    commands = np.array([0.05, -0.02])
    there = advance(start, 15.0, car, 0.02, commands, 0.15)
    a, b, _ = continuous(BMW, 15.0)
    system = np.zeros((5, 5))
    system[:4, :4], system[:4, 4] = a, b
    if lag:
        system[4, 4] = -1.0 / lag
    x = start[:5].copy()
    for command in commands:
        if not lag:
            x[4] = command
        inputs = np.array([[0.0], [-0.15], [0.0], [0.0], [command / lag if lag else 0.0]])
        a_k, g_k = discretise(system, inputs, 0.02)
        x = a_k @ x + g_k[:, 0]
    assert there[:5] == pytest.approx(x, abs=1e-10)
    assert there[5] == commands[-1]


def test_nothing_on_its_way_changes_nothing():
    start = np.arange(6.0)
    assert np.array_equal(advance(start, 15.0, CAR, 0.02, np.zeros(0), 0.0), start)


@pytest.mark.parametrize("speed", [5.0, 15.0, 30.0])
def test_steady_gain_is_the_limit_of_the_model(speed):
    a, b, _ = continuous(BMW, speed)
    beta, gamma = np.linalg.solve(a[2:, 2:], -b[2:])
    assert steady_gain(speed, CAR) == pytest.approx(speed * gamma, rel=1e-9)
    assert np.isfinite(beta)


@pytest.mark.parametrize("period", [0.005, 0.01, 0.02, 0.04, 0.05, 0.1])
def test_grid_covers_the_horizon(period):
    level, block = grid(period)
    steps = period * 2.0**level
    assert abs(steps.sum() - HORIZON) <= steps.max()
    assert steps.max() <= max(COARSEST_STEP * 1.5, period)
    assert len(block) == len(level)
    assert set(np.diff(block)) <= {0, 1}
    assert np.all(np.diff(level) >= 0)


def test_below_the_slowest_speed_the_model_stands_still():
    assert np.array_equal(model_block(0.0, CAR), model_block(SLOWEST, CAR))
