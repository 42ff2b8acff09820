"""Identification from logs: the model's own mathematics, a known car found again, and what cannot be told refused."""

import numpy as np
import pytest
from support.measured_logs import CHASSIS, MAP, log_table, true_values, write_table

from sidestep.plant_models.linear.bicycle import continuous
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.model_error.identification.car_kernel import simulate
from sidestep.validation.model_error.identification.log_identification import identify_log, windows_of
from sidestep.validation.model_error.identification.log_parameters import begin, implausible
from sidestep.validation.model_error.logs.made import Sensors, known_car, made_log, write_log
from sidestep.validation.model_error.logs.mapping import LogMap, read_map
from sidestep.validation.model_error.logs.measured import PERIOD, load_log


@pytest.fixture
def log_of(tmp_path):
    def load(columns, text=""):
        write_table(tmp_path / "log.csv", columns)
        (tmp_path / "map.toml").write_text(text + MAP, encoding="utf-8")
        mapping = read_map(tmp_path / "map.toml")
        return load_log(tmp_path / "log.csv", mapping), mapping.vehicle

    return load


def held(steer, speed, n):
    flat = np.full(n, steer), np.full(n, speed), np.zeros(n), np.zeros(n), np.zeros(n)
    return dict(zip(("steer", "v_x", "a_x", "start_yaw_rate", "start_v_y"), flat, strict=True))


def run(values, steer=0.02, speed=20.0, n=600, linear=False, bank=0.0):
    moved = np.array([[0.0, 0.0, bank, bank]])
    return simulate(values, CHASSIS, held(steer, speed, n), np.array([0]), n, moved, linear)[0]


def test_steady_state_of_the_linear_car_is_the_bicycle_models():
    values = begin(CHASSIS, 1.0, 0.5)._replace(roll_gain=0.0)
    car = VehicleParameters.preset("bmw-320i").with_(
        mass=CHASSIS.mass, l_f=CHASSIS.l_f, l_r=CHASSIS.l_r, yaw_inertia=values.I_z,
        cornering_stiffness_front=values.C_f, cornering_stiffness_rear=values.C_r,
    )  # fmt: skip
    a, b, _ = continuous(car, 20.0)
    beta, rate = -np.linalg.solve(a[2:, 2:], b[2:]) * 0.002
    end = run(values, 0.002, linear=True)[-1]
    assert end == pytest.approx([rate, 20.0 * rate, 20.0 * beta], rel=2e-4)


def test_small_steering_makes_linear_and_magic_formula_agree():
    values = begin(CHASSIS, 1.0, 0.5)
    np.testing.assert_allclose(run(values, 1e-4)[-1], run(values, 1e-4, linear=True)[-1], rtol=1e-3)


def test_the_axles_saturate_at_their_peaks():
    end = run(true_values(steer_offset=0.0, a_y_offset=0.0, roll_gain=0.0), 0.2)[-1]
    assert 0.8 * GRAVITY < end[1] < 1.05 * GRAVITY


def test_a_body_sensor_feels_roll_but_no_bank():
    values = true_values(steer_offset=0.0, a_y_offset=0.0, yaw_rate_offset=0.0, roll_gain=0.006)
    turn = run(values)[-1]
    force = 20.0 * turn[0]
    assert turn[1] == pytest.approx(force * (1.0 + 0.006 * GRAVITY), rel=1e-3)
    banked = run(values, 0.0, bank=0.5)[-1]  # the wheels hold the car on the slope: a force, no acceleration
    assert banked[1] == pytest.approx((20.0 * banked[0] + 0.5) * (1.0 + 0.006 * GRAVITY), rel=1e-2)


def test_half_the_step_changes_little(log_of):
    """The kernel's step is PERIOD; against itself at a tenth of it."""
    from sidestep.validation.model_error.identification import car_kernel

    values, coarse, fine = true_values(), np.empty((1, 500, 3)), np.empty((1, 5000, 3))
    for out, n in ((coarse, 600), (fine, 6000)):
        h = PERIOD * 500 / out.shape[1]
        time = h * np.arange(n)
        steer = 0.03 * np.sin(2.0 * np.pi * 0.8 * time)
        flat = np.full(n, 20.0), np.zeros(n), np.zeros(n), np.zeros(n)
        car_kernel._run(
            np.array(values), np.array(CHASSIS), steer, *flat, np.array([0]), np.zeros((1, 4)), h, False, out
        )  # fmt: skip
    change = np.abs(coarse[0] - fine[0, ::10]).max(axis=0) / np.abs(fine[0]).max(axis=0)
    assert (change < 0.012).all()


def test_a_known_car_is_found_again(log_of):
    true = true_values()
    log, vehicle = log_of(log_table(true))
    found = identify_log(log, vehicle)
    assert not found.problem
    assert not found.left_out
    for verdict in found.verdicts:
        if not verdict.refused:
            margin = 0.5 * (verdict.high - verdict.low)  # twice the interval: one seed of many
            truth = getattr(true, verdict.parameter.name)
            assert verdict.low - margin <= truth <= verdict.high + margin, verdict.parameter.name
    known = {v.parameter.name for v in found.verdicts if not v.refused}
    assert {"C_f", "C_r", "I_z", "steer_delay", "steer_offset", "yaw_rate_offset", "a_y_offset"} <= known
    assert found.values.steer_delay == pytest.approx(true.steer_delay, abs=0.002)


def test_the_mujoco_car_is_found_behind_noise_offsets_delay_and_bank(tmp_path):
    """The small version of benchmarks/studies/log_coverage.py."""
    car = known_car()
    table, true = made_log(car, Sensors(), seed=3, duration=60.0)
    write_log(tmp_path / "made.csv", table)
    log = load_log(tmp_path / "made.csv", LogMap({}, car, ()))
    found = identify_log(log, car)
    verdicts = {v.parameter.name: v for v in found.verdicts if not v.refused}
    assert {"C_f", "C_r", "I_z", "steer_gain", "steer_delay", "steer_offset", "roll_gain"} <= set(verdicts)
    inside = [v.low <= true[name] <= v.high for name, v in verdicts.items() if name in true]
    assert np.mean(inside) >= 0.8
    assert verdicts["steer_delay"].value == pytest.approx(true["steer_delay"], abs=0.004)
    assert 1.0 / verdicts["steer_gain"].value == pytest.approx(14.5, rel=0.03)


def test_yaw_rate_alone_identifies_no_inertia(log_of):
    columns = {k: v for k, v in log_table(true_values()).items() if k[:3] not in ("a_y", "v_y")}
    log, vehicle = log_of(columns)
    found = identify_log(log, vehicle)
    refused = {v.parameter.name: v.refused for v in found.verdicts}
    assert found.explained["yaw_rate"] > 0.99
    assert "yaw rate alone cannot tell" in refused["I_z"]
    assert "no a_y and no v_y" in refused["C_f"]
    assert not refused["steer_delay"]


def test_a_signal_that_contradicts_the_others_is_left_out(log_of):
    columns = log_table(true_values())
    columns["v_y [m/s]"] = -1.5 * columns["v_y [m/s]"]
    log, vehicle = log_of(columns)
    found = identify_log(log, vehicle)
    assert set(found.left_out) == {"v_y"}
    assert "contradicts the yaw rate" in found.left_out["v_y"]
    assert found.values.C_f == pytest.approx(90e3, rel=0.06)  # the windows do not begin at it either
    assert found.values.C_r == pytest.approx(85e3, rel=0.06)


def test_too_little_steering_is_refused_parameter_by_parameter(log_of):
    log, vehicle = log_of(log_table(true_values(), acceleration=0.3))
    found = identify_log(log, vehicle)
    assert "too little steering" in found.problem
    assert all("too little steering" in v.refused for v in found.verdicts)


def test_gentle_driving_tells_stiffness_but_no_peak(log_of):
    log, vehicle = log_of(log_table(true_values(), acceleration=3.0))
    found = identify_log(log, vehicle)
    assert found.known("C_f")
    assert not found.known("mu_f")
    (reason,) = [v.refused for v in found.verdicts if v.parameter.name == "mu_f"]
    assert "known to no better" in reason or "do not tell" in reason


def test_a_delay_that_was_told_is_not_fitted(log_of):
    told = '[signals]\nsteer = { name = "road_wheel_angle [rad]", delay = -0.03 }\n'
    log, vehicle = log_of(log_table(true_values()), told)
    found = identify_log(log, vehicle)
    assert "steer_delay" not in {v.parameter.name for v in found.verdicts}
    assert found.known("I_z")
    assert found.values.I_z == pytest.approx(1500.0, rel=0.06)


def test_windows_stay_within_what_is_usable(log_of):
    columns = log_table(true_values(), duration=30.0)
    columns["yaw_rate [rad/s]"][1000:1200] = np.nan
    log, _ = log_of(columns)
    windows = windows_of(log, 3.0, ("yaw_rate",))
    inside = windows.starts[:, None] + np.arange(windows.steps)
    assert log.usable[inside].all()
    assert len(windows.starts) >= 6


def test_no_car_has_such_numbers():
    odd = implausible(true_values(I_z=9000.0, C_r=3e6), CHASSIS)
    assert set(odd) == {"I_z", "C_r"}
    assert implausible(true_values(), CHASSIS) == {}
