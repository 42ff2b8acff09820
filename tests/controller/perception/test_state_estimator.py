"""The state estimator: its numbers mean what they say, and sensors may be late or wrong."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from support.filter_case import PERIOD, forward, shown

from sidestep.controller.perception import state_estimator as layout
from sidestep.controller.perception.estimator import EstimatorConfig, Measurement, StateEstimator
from sidestep.controller.perception.state_estimator import SIGNALS, SLOT, STATES
from sidestep.controller.records import record
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
POSE = ("x", "y", "yaw")
NOISE = {
    "x": 0.02, "y": 0.02, "yaw": 0.0035, "v_x": 0.05, "yaw_rate": 0.005, "steer_angle": 0.001,
}  # fmt: skip


def world(estimator, seed, count):
    """A drive of the filter's own model with all its noise: true states, measurements in time, commands."""
    random = np.random.default_rng(seed)
    start, walk, noise = (estimator._settings[name][0] for name in ("start", "walk", "noise"))
    truth, drive = np.zeros(STATES), []
    truth[layout.V_X] = 15.0
    for k in (layout.V_Y, layout.BIAS, layout.ACTUATOR, layout.SENSOR, layout.SHARE):
        truth[k] = start[k] * random.standard_normal()
    slots = record(SLOT), record(SLOT)
    for k in range(count):
        command = 0.03 * math.sin(2.0 * k * PERIOD)
        slots[0]["x"] = truth
        shows = [shown(slots[0], i, estimator._car, estimator._settings, estimator._work) for i in range(SIGNALS)]
        shows += noise * random.standard_normal(SIGNALS)
        drive.append((truth.copy(), measurement(k * PERIOD, shows, pose=k % 5 == 0), command))
        slots[0]["command"], slots[0]["acceleration"], slots[1]["time"] = command, math.nan, PERIOD
        forward(*slots, estimator._car, estimator._settings, estimator._work)
        slots[0]["steer_rate"] = slots[1]["steer_rate"]
        truth = slots[1]["x"][0] + walk * math.sqrt(PERIOD) * random.standard_normal(STATES)
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
        drive = list(world(filtered, seed, count))
        for k, (_, measured, command) in enumerate(drive):
            filtered.step(measured)
            filtered.tell(command)
            square, freedom = filtered.normalised_square
            squares[k], degrees[k] = squares[k] + square, degrees[k] + freedom
        missed = filtered._out[1:] - drive[-1][0]
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
    drive = list(true_and_measured())
    for _, m, command in drive:
        early.step(m)
        late.step(replace(m, x=math.nan, y=math.nan, yaw=math.nan, pose_time=math.nan))
        early.tell(command)
        late.tell(command)
        waiting.append(m)
        if len(waiting) > 10:
            old = waiting.pop(0)
            late.step(Measurement(m.time, x=old.x, y=old.y, yaw=old.yaw, pose_time=old.time))
    for old in waiting:
        late.step(Measurement(drive[-1][1].time, x=old.x, y=old.y, yaw=old.yaw, pose_time=old.time))
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
    drive = list(true_and_measured())
    for truth, measured, _ in drive:
        filtered.step(replace(measured, x=measured.x + (100.0 if truth.time > 1.0 else 0.0)))
    assert filtered.rejected["x"] == filtered.config.patience
    assert filtered.state.x == pytest.approx(drive[-1][0].x + 100.0, abs=0.1)


def test_what_is_not_measured_or_comes_at_no_time_changes_nothing():
    filtered = StateEstimator(BMW)
    drive = list(true_and_measured(1.0))
    for _, measured, _ in drive:
        filtered.step(measured)
    newest = drive[-1][1].time
    state, covariance = filtered.state, filtered.covariance
    for other in (Measurement(math.nan, v_x=3.0), Measurement(newest - 0.6, v_x=3.0), Measurement(-1.0, v_x=3.0)):
        assert filtered.step(other) == state
    assert (filtered.rejected["unusable"], filtered.rejected["too_late"]) == (1, 2)
    filtered.step(Measurement(newest + PERIOD))
    grown = np.diag(filtered.covariance) - np.diag(covariance)
    assert (grown[[layout.X, layout.V_X, layout.YAW, layout.SHARE]] > 0.0).all()
    filtered.step(Measurement(newest + 2.0 * PERIOD, x=1e9, y=math.inf, pose_time=newest + 1.0))
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
        filtered.step(Measurement(k * PERIOD, 1.0, 2.0, 0.3, 0.0, yaw_rate=rate, steer_angle=0.1))
    assert filtered.disturbances["bias"] == pytest.approx(0.02, abs=0.002)
    assert abs(filtered.state.yaw_rate) < 0.003
    assert filtered.state.yaw == pytest.approx(0.3, abs=0.005)


def test_yaw_is_continuous_over_whole_turns():
    filtered = StateEstimator(BMW)
    for k in range(400):
        yaw = 0.5 * k * PERIOD + 3.0
        wrapped = yaw - math.tau * round(yaw / math.tau)
        filtered.step(Measurement(k * PERIOD, yaw=wrapped, v_x=10.0, yaw_rate=0.5))
    assert filtered.state.yaw == pytest.approx(0.5 * 399 * PERIOD + 3.0, abs=0.01)


def test_impossible_settings_name_their_key():
    with pytest.raises(InputError, match=r"estimator\.yaw_noise"):
        EstimatorConfig(yaw_noise=0.0)
    with pytest.raises(InputError, match=r"estimator\.sliding"):
        EstimatorConfig(rolling=4.0)
