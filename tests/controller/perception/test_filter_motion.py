"""The filter's prediction is the controller's model, and its derivatives are those of what it does."""

import math

import numpy as np
import pytest
from support.filter_case import PERIOD, predicted, shown, state_at

from sidestep.controller.mpc.car_model import Car
from sidestep.controller.mpc.discretise import WIDTH
from sidestep.controller.mpc.prediction import advance, model_block
from sidestep.controller.perception import state_estimator as layout
from sidestep.controller.perception.estimator import EstimatorConfig, StateEstimator
from sidestep.controller.perception.state_estimator import SIGNALS, SLOT, STATES
from sidestep.controller.records import record
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")


def linear(config=None):
    """An estimator whose tangents stay where they are, so that its derivatives are exact."""
    made = StateEstimator(BMW, config)
    made._car["affine"] = False
    return made


def assert_derivatives_agree(found, expected):
    """The tyres' lag and the implicit step change with speed, too: derivatives by v_x are nearly so only."""
    others = np.arange(STATES) != layout.V_X
    np.testing.assert_allclose(found[..., others], expected[..., others], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found[..., layout.V_X], expected[..., layout.V_X], rtol=0.05, atol=0.2)


@pytest.mark.parametrize("speed", [0.5, 3.0, 15.0, 30.0])
@pytest.mark.parametrize("command", [math.nan, 0.055, 0.5], ids=["unknown", "lag", "rate limit"])
def test_transition_is_the_derivative_of_the_prediction(speed, command):
    estimator, x, step = linear(), state_at(speed), 1e-6
    predicted(estimator, x, command)
    transition = np.eye(STATES)
    transition[: layout.BIAS] = estimator._work["transition"][0, : layout.BIAS]
    ends = [[predicted(estimator, x + s * row, command)["x"][0] for s in (step, -step)] for row in np.eye(STATES)]
    assert_derivatives_agree(transition, np.array([(above - below) / (2.0 * step) for above, below in ends]).T)


@pytest.mark.parametrize("speed", [1.0, 3.0, 15.0, 30.0])
def test_row_is_the_derivative_of_what_a_signal_should_show(speed):
    estimator, x, step, now = linear(EstimatorConfig(lever=0.4)), state_at(speed), 1e-6, record(SLOT)
    now["steer_rate"] = 0.3

    def value(signal, state):
        now["x"] = state
        return shown(now, signal, estimator._car, estimator._settings, estimator._work)

    for signal in range(SIGNALS):
        slopes = [
            (value(signal, x + step * row) - value(signal, x - step * row)) / (2.0 * step) for row in np.eye(STATES)
        ]
        value(signal, x)
        assert_derivatives_agree(estimator._work["row"][0], np.array(slopes))


def test_prediction_is_the_controllers_nonlinear_model():
    estimator = StateEstimator(BMW)
    estimator._car["relaxation"] = 0.0
    x = np.zeros(STATES)
    x[layout.V_X], x[layout.V_Y], x[layout.YAW_RATE] = 15.0, -0.3, 0.1
    beta, car = x[layout.V_Y] / 15.0, Car.of(BMW, True, 1.0)._replace(relaxation=0.0)
    own = np.array([0.0, 0.0, beta, 0.1, 0.0, 0.0])
    for _ in range(15):
        advance(own, np.zeros(2), (15.0, 0.0), (0.0, 0.0), 0.06, PERIOD, car, np.empty((6, 6)))
        after = predicted(estimator, x, 0.06)
        x = after["x"][0].copy()
        x[layout.V_X] = 15.0
    assert x[layout.V_Y] / 15.0 == pytest.approx(own[2], abs=2e-4)
    assert x[layout.YAW_RATE] == pytest.approx(own[3], abs=2e-3)
    assert x[layout.STEER] == pytest.approx(own[4], abs=1e-7)


def test_forces_lag_behind_slip_as_in_the_controllers_model():
    """At rest but for the steering on its way: the first derivatives of (beta, yaw rate) are the block's."""
    estimator, car, block = StateEstimator(BMW), Car.of(BMW, True, 1.0), np.empty((6, WIDTH))
    assert car.relaxation > 0.0
    x = np.zeros(STATES)
    x[layout.V_X] = 15.0
    h, command = 1e-5, 0.001
    slot = predicted(estimator, x, command, h)
    after, tangents = slot["x"][0], slot["tangents"][0]
    model_block(15.0, tangents[0], tangents[2], car, block)
    rates = block[:, 5] * command
    assert after[layout.V_Y] / 15.0 / h == pytest.approx(rates[2], rel=1e-3)
    assert after[layout.YAW_RATE] / h == pytest.approx(rates[3], rel=1e-3)


def test_slow_car_rolls_where_its_wheels_point():
    estimator, x = StateEstimator(BMW), np.zeros(STATES)
    x[layout.V_X], x[layout.STEER] = 1.0, 0.3
    after = predicted(estimator, x, math.nan)["x"][0]
    turn = after[layout.V_X] * math.tan(0.3) / BMW.wheelbase
    assert after[layout.YAW_RATE] == pytest.approx(turn)
    assert after[layout.V_Y] == pytest.approx(BMW.l_r * turn)
    x[layout.V_X] = 0.0
    standing = predicted(estimator, x, math.nan)["x"][0]
    assert abs(standing[layout.YAW_RATE]) < 1e-2  # the little that it gathers in the step


def test_tyres_at_work_are_doubted():
    grown = []
    for doubt in (0.0, 0.1):
        estimator, x = StateEstimator(BMW, EstimatorConfig(force_doubt=doubt)), state_at(15.0)
        after = predicted(estimator, x, math.nan)
        forces, noise = estimator._work["axle"][0], after["P"][0]
        grown.append(np.array([noise[layout.V_Y, layout.V_Y], noise[layout.YAW_RATE, layout.YAW_RATE]]))
    levers = np.array([[1.0 / BMW.mass] * 2, [BMW.l_f / BMW.yaw_inertia, BMW.l_r / BMW.yaw_inertia]])
    assert np.abs(forces).min() > 100.0
    np.testing.assert_allclose(grown[1] - grown[0], np.square(0.1 * levers * forces).sum(axis=1) * PERIOD, rtol=1e-6)
