"""The state estimator: it predicts as the model does, its numbers mean what they say, sensors may be late or wrong."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from scipy.stats import chi2

from sidestep.controller.mpc.car_model import Car
from sidestep.controller.mpc.discretise import WIDTH
from sidestep.controller.mpc.prediction import advance, model_block
from sidestep.controller.perception import state_estimator as layout
from sidestep.controller.perception.estimator import EstimatorConfig, Measurement, StateEstimator
from sidestep.controller.perception.filter_motion import predict, touch
from sidestep.controller.perception.filter_update import expect
from sidestep.controller.perception.state_estimator import SIGNALS, SLOT, STATES
from sidestep.controller.records import record
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
PERIOD = 0.02
POSE = ("x", "y", "yaw")
NOISE = {
    "x": 0.02, "y": 0.02, "yaw": 0.0035, "v_x": 0.05, "yaw_rate": 0.005, "steer_angle": 0.001,
}  # fmt: skip


def predicted(estimator, state, command, time=PERIOD):
    before, after = record(SLOT), record(SLOT)
    before["x"], before["command"], before["acceleration"], after["time"] = state, command, 0.0, time
    forward(before, after, estimator._car, estimator._settings, estimator._work)
    return after


@njit
def forward(before, after, cars, settings, work):
    touch(before[0], cars[0], settings[0])
    predict(before[0], after[0], cars[0], settings[0], work[0])


@njit
def shown(now, signal, cars, settings, work):
    touch(now[0], cars[0], settings[0])
    return expect(now[0], signal, cars[0], settings[0], work[0])


def state_at(speed):
    return np.array([3.0, -2.0, 0.7, speed, -0.02 * speed, 0.2, 0.05, 0.01, 0.004, -0.003, 0.02])


def linear(config=None):
    """An estimator whose tangents stay where they are, so that its derivatives are exact."""
    made = StateEstimator(BMW, config)
    made._car["affine"] = False
    return made


def compare(found, expected):
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
    compare(transition, np.array([(above - below) / (2.0 * step) for above, below in ends]).T)


@pytest.mark.parametrize("speed", [1.0, 3.0, 15.0, 30.0])
def test_row_is_the_derivative_of_what_a_signal_should_show(speed):
    estimator, x, step, now = linear(EstimatorConfig(lever=0.4)), state_at(speed), 1e-6, record(SLOT)
    now["steer_rate"] = 0.3

    def value(state, signal):
        now["x"] = state
        return shown(now, signal, estimator._car, estimator._settings, estimator._work)

    for signal in range(SIGNALS):
        ends = [(value(x + step * row, signal), value(x - step * row, signal)) for row in np.eye(STATES)]
        slopes = [(above - below) / (2.0 * step) for above, below in ends]
        value(x, signal)
        compare(estimator._work["row"][0], np.array(slopes))


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


def world(estimator, seed, count, period=PERIOD):
    """A drive of the filter's own model with all its noise: true states, measurements in time, commands."""
    random = np.random.default_rng(seed)
    start, walk, noise = (estimator._settings[name][0] for name in ("start", "walk", "noise"))
    truth, drive = np.zeros(STATES), []
    truth[layout.V_X] = 15.0
    for k in (layout.V_Y, layout.BIAS, layout.ACTUATOR, layout.SENSOR, layout.SHARE):
        truth[k] = start[k] * random.standard_normal()
    slots = record(SLOT), record(SLOT)
    for k in range(count):
        command = 0.03 * math.sin(2.0 * k * period)
        slots[0]["x"] = truth
        shows = [shown(slots[0], i, estimator._car, estimator._settings, estimator._work) for i in range(SIGNALS)]
        shows += noise * random.standard_normal(SIGNALS)
        drive.append((truth.copy(), measurement(k * period, shows, pose=k % 5 == 0), command))
        slots[0]["command"], slots[0]["acceleration"], slots[1]["time"] = command, math.nan, period
        forward(*slots, estimator._car, estimator._settings, estimator._work)
        slots[0]["steer_rate"] = slots[1]["steer_rate"]
        truth = slots[1]["x"][0] + walk * math.sqrt(period) * random.standard_normal(STATES)
    return drive


def measurement(time, shows, pose):
    values = dict(zip(layout.SIGNAL_NAMES, map(float, shows), strict=True)) | {"v_y": math.nan}
    if not pose:
        values |= dict.fromkeys(POSE, math.nan)
    return Measurement(time, **values)


@pytest.mark.closed_loop
def test_normalised_innovations_are_chi_square_over_100_seeds():
    """At each time the mean over the seeds is in its own 95 % band, but for some 5 % of the times."""
    count, seeds, filtered = 200, 100, StateEstimator(BMW, EstimatorConfig(start_v_y=0.1, force_doubt=0.0))
    squares, degrees, errors = np.zeros(count), np.zeros(count), []
    for seed in range(seeds):
        filtered.reset()
        for k, (truth, measured, command) in enumerate(world(filtered, seed, count)):  # noqa: B007 (the last is used)
            filtered.step(measured)
            filtered.tell(command)
            square, freedom = filtered.normalised_square
            squares[k], degrees[k] = squares[k] + square, degrees[k] + freedom
        missed = filtered._out[1:] - truth  # the last of them
        errors.append(missed @ np.linalg.solve(filtered.covariance, missed))
    low, high = chi2.ppf([[0.025], [0.975]], degrees[1:])
    inside = np.mean((squares[1:] >= low) & (squares[1:] <= high))
    low, high = chi2.ppf([0.025, 0.975], degrees[1:].sum())
    assert inside >= 0.9
    assert low <= squares[1:].sum() <= high
    low, high = chi2.ppf([0.025, 0.975], seeds * STATES)
    assert low <= np.sum(errors) <= high


def true_and_measured(seconds=4.0, late=0):
    """A linear plant under a sine of steering, poses at 10 Hz, `late` periods old: true state, measurement, command."""
    random, plant, past = np.random.default_rng(1), LinearPlant(BMW), []
    state = plant.reset(VehicleState(v_x=15.0))
    for k in range(round(seconds / PERIOD)):
        past.append(state)
        command = 0.02 * math.sin(2.0 * state.time)
        noisy = {name: getattr(state, name) + sigma * random.standard_normal() for name, sigma in NOISE.items()}
        known = {name: value for name, value in noisy.items() if name not in POSE}
        pose = {"pose_time": math.nan}
        if k % 5 == 0 and k >= late:
            pose = {name: noisy[name] + getattr(past[k - late], name) - getattr(state, name) for name in POSE}
            pose["pose_time"] = past[k - late].time
        yield state, Measurement(state.time, **known, **pose), command
        state = plant.step(SteeringCommand(state.time, command, 15.0), PERIOD)


def test_late_pose_is_worth_what_it_would_have_been_in_time():
    """The same poses, told 0.2 s late or in time: the same state, once all have come."""
    early, late, waiting = StateEstimator(BMW), StateEstimator(BMW), []
    for _, m, command in true_and_measured():
        early.step(m)
        late.step(replace(m, x=math.nan, y=math.nan, yaw=math.nan, pose_time=math.nan))
        early.tell(command)
        late.tell(command)
        waiting.append(m)
        if len(waiting) > 10:
            old = waiting.pop(0)
            late.step(Measurement(m.time, x=old.x, y=old.y, yaw=old.yaw, pose_time=old.time))
    for old in waiting:
        late.step(Measurement(m.time, x=old.x, y=old.y, yaw=old.yaw, pose_time=old.time))
    assert sum(early.rejected.values()) == sum(late.rejected.values())
    np.testing.assert_allclose(late._out, early._out, atol=1e-3)
    np.testing.assert_allclose(late.covariance, early.covariance, rtol=0.02, atol=1e-6)


@pytest.mark.closed_loop
@pytest.mark.parametrize("late", [0, 5, 20])
def test_state_comes_out_without_v_y(late):
    filtered, errors = StateEstimator(BMW), []
    for truth, measured, command in true_and_measured(8.0, late):
        state = filtered.step(measured)
        filtered.tell(command)
        errors.append([getattr(state, name) - getattr(truth, name) for name in layout.NAMES[: layout.BIAS]])
        deviations = np.sqrt(np.diag(filtered.covariance))[: layout.BIAS]
    rms = np.sqrt(np.mean(np.square(errors[100:]), axis=0))
    assert (rms < 3.0 * deviations).all()
    assert (rms[:3] < [0.03, 0.03, 0.003]).all()
    assert rms[layout.V_Y] < 0.05


def test_wild_measurement_is_left_out_and_counted():
    calm, hit = StateEstimator(BMW), StateEstimator(BMW)
    for k, (_, measured, _) in enumerate(true_and_measured()):
        calm.step(measured)
        wild = measured
        if k in (100, 150):
            wild = replace(measured, x=measured.x + 5.0, v_x=25.0)
        hit.step(wild)
    assert hit.rejected["v_x"] == 2 + calm.rejected["v_x"]
    assert hit.rejected["x"] == hit.rejected["y"] == 2 + calm.rejected["x"]
    np.testing.assert_allclose(hit._out, calm._out, atol=0.02)


def test_sensor_that_stays_away_is_believed_in_the_end():
    filtered = StateEstimator(BMW)
    for truth, measured, _ in true_and_measured():
        state = filtered.step(replace(measured, x=measured.x + (100.0 if truth.time > 1.0 else 0.0)))
    assert filtered.rejected["x"] == filtered.config.patience
    assert state.x == pytest.approx(truth.x + 100.0, abs=0.1)


def test_what_is_not_measured_or_comes_at_no_time_changes_nothing():
    filtered = StateEstimator(BMW)
    for _, measured, _ in true_and_measured(1.0):
        filtered.step(measured)
    state, covariance = filtered.state, filtered.covariance
    for other in (
        Measurement(math.nan, v_x=3.0),
        Measurement(measured.time - 0.6, v_x=3.0),
        Measurement(-1.0, v_x=3.0),
    ):
        assert filtered.step(other) == state
    assert (filtered.rejected["unusable"], filtered.rejected["too_late"]) == (1, 2)
    filtered.step(Measurement(measured.time + PERIOD))
    grown = np.diag(filtered.covariance) - np.diag(covariance)
    assert (grown[[layout.X, layout.V_X, layout.YAW, layout.SHARE]] > 0.0).all()
    filtered.step(Measurement(measured.time + 2.0 * PERIOD, x=1e9, y=math.inf, pose_time=measured.time + 1.0))
    assert filtered.rejected["unusable"] == 2


def test_covariance_stays_symmetric_and_positive():
    filtered = StateEstimator(BMW, EstimatorConfig(yaw_rate_noise=1e-6, steer_noise=1e-6, position_noise=1e-4))
    for _, measured, command in true_and_measured(4.0, late=10):
        filtered.step(measured)
        filtered.tell(command)
        covariance = filtered.covariance
        assert (covariance == covariance.T).all()
        scale = np.sqrt(np.diag(covariance))
        assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > -1e-9


def test_restored_estimator_goes_on_to_the_last_bit():
    drive = [measured for _, measured, _ in true_and_measured(3.0, late=5)]
    original, other = StateEstimator(BMW), StateEstimator(BMW)
    for measured in drive[:90]:
        original.step(measured)
    memory = original.save()
    expected = [(original.step(measured), original.covariance.tobytes()) for measured in drive[90:]]
    other.step(drive[3])
    other.restore(memory)
    assert other.state.time == drive[89].time
    assert [(other.step(measured), other.covariance.tobytes()) for measured in drive[90:]] == expected
    assert other.save() == original.save()
    with pytest.raises(InputError, match="memory"):
        other.restore(memory[:-1] + bytes([memory[-1] ^ 1]))


def test_yaw_rate_bias_shows_at_standstill_and_does_not_turn_the_car():
    filtered, random = StateEstimator(BMW), np.random.default_rng(0)
    for k in range(500):
        rate = 0.02 + 0.005 * random.standard_normal()
        state = filtered.step(Measurement(k * PERIOD, 1.0, 2.0, 0.3, 0.0, yaw_rate=rate, steer_angle=0.1))
    assert filtered.disturbances["bias"] == pytest.approx(0.02, abs=0.002)
    assert abs(state.yaw_rate) < 0.003
    assert state.yaw == pytest.approx(0.3, abs=0.005)


def test_yaw_is_continuous_over_whole_turns():
    filtered = StateEstimator(BMW)
    for k in range(400):
        yaw = 0.5 * k * PERIOD + 3.0
        wrapped = yaw - math.tau * round(yaw / math.tau)
        state = filtered.step(Measurement(k * PERIOD, yaw=wrapped, v_x=10.0, yaw_rate=0.5))
    assert state.yaw == pytest.approx(yaw, abs=0.01)


def test_impossible_settings_name_their_key():
    with pytest.raises(InputError, match=r"estimator\.yaw_noise"):
        EstimatorConfig(yaw_noise=0.0)
    with pytest.raises(InputError, match=r"estimator\.sliding"):
        EstimatorConfig(rolling=4.0)


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
