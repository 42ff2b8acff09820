"""The prediction model against scipy's matrix exponential, the paper's equations and independent integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from sidestep.controller import ControllerConfig
from sidestep.controller.mpc.car_model import Car, axle_force, slip_angles, tangent
from sidestep.controller.mpc.discretise import exponential, square
from sidestep.controller.mpc.grid import COARSEST_STEP, HORIZON, grid
from sidestep.controller.mpc.prediction import (
    FRONT,
    RATE,
    REAR,
    SLOWEST,
    TURN,
    advance,
    linearise,
    model_block,
    steady_gain,
    tyre_lag,
)
from sidestep.controller.records import WORK, record
from sidestep.controller.settings import settings_of
from sidestep.plant_models.linear.bicycle import continuous
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
LINEAR, AFFINE = Car.of(BMW, False, 1.0), Car.of(BMW, True, 1.0)


def block(speed, car=LINEAR):
    generator = np.empty((6, 10))
    model_block(speed, car.stiffness_f, car.stiffness_r, car, generator)
    return generator


def discrete(generator, dt):
    e = np.empty((6, 10))
    exponential(generator, dt, e, np.empty((4, 6, 10)))
    return e


def whole(a):
    full = np.zeros((10, 10))
    full[:6] = a
    return full


@pytest.mark.parametrize("speed", [14.0, 18.0, 25.0])
def test_lag_of_the_tyres_is_nearly_that_of_slip_angles_as_states(speed):
    at_once = block(speed, AFFINE._replace(relaxation=0.0))
    true = np.zeros((12, 12))  # [x; lagging slip angles; w], axle forces by the latter
    true[:6, :6], true[:6, 8:] = at_once[:, :6], at_once[:, 6:]
    slips = np.zeros((2, 12))
    slips[0, [2, 3, 4]], slips[1, [2, 3]] = (-1.0, -BMW.l_f / speed, 1.0), (-1.0, BMW.l_r / speed)
    for axle, (stiffness, lever) in enumerate(((AFFINE.stiffness_f, BMW.l_f), (AFFINE.stiffness_r, -BMW.l_r))):
        force = np.array([1.0 / (BMW.mass * speed), lever / BMW.yaw_inertia]) * stiffness
        true[2:4] -= np.outer(force, slips[axle])
        true[2:4, 6 + axle] += force
    true[6:8] = speed / AFFINE.relaxation * slips
    true[[6, 7], [6, 7]] -= speed / AFFINE.relaxation
    ramp = expm(0.3 * true)[:4, 8]
    late, early = (expm(0.3 * whole(a))[:4, RATE] for a in (block(speed, AFFINE), at_once))
    assert np.abs((late - ramp) / ramp).max() < 0.4 * np.abs((early - ramp) / ramp).max()


@pytest.mark.parametrize("speed", [0.0, 2.0, 15.0, 35.0])
@pytest.mark.parametrize("dt", [0.01, 0.02, 0.16])
def test_exponential_is_that_of_scipy(speed, dt):
    expected = expm(whole(block(speed)) * dt)[:6]
    assert discrete(block(speed), dt) == pytest.approx(expected, abs=1e-9)


def test_doubling_is_the_exponential_of_twice_the_step():
    e = discrete(block(15.0), 0.04)
    square(e, np.empty((6, 10)))
    assert e == pytest.approx(discrete(block(15.0), 0.08), abs=1e-12)


def test_model_is_equation_5():
    a, b, _ = continuous(BMW, 15.0)
    assert block(15.0)[:4, :4] == pytest.approx(a)
    assert block(15.0)[:4, 4] == pytest.approx(b)
    assert block(15.0)[1, TURN] == -1.0  # v kappa enters as the road's turn rate
    assert block(15.0)[5, RATE] == 1.0


def test_axle_forces_enter_like_those_of_the_tyres():
    """A force at zero slip acts like the slip angle that would make it."""
    a = block(15.0)
    assert a[2:4, FRONT] * LINEAR.stiffness_f == pytest.approx(a[2:4, 4])
    assert a[2, REAR] == a[2, FRONT]
    assert a[3, REAR] * BMW.l_f == pytest.approx(-a[3, FRONT] * BMW.l_r)


def test_tangents_touch_the_magic_formula():
    for slip in (-0.1, -0.03, 0.0, 0.02, 0.08):
        slope, force = tangent(slip, 0.0, AFFINE.stiffness_f, AFFINE.load_f, AFFINE)
        real = axle_force(slip, AFFINE.stiffness_f, AFFINE.load_f, AFFINE)
        beside = axle_force(slip + 1e-3, AFFINE.stiffness_f, AFFINE.load_f, AFFINE)
        assert force + slope * slip == pytest.approx(real)
        assert force + slope * (slip + 1e-3) == pytest.approx(beside, abs=5.0)


def lines_of(tyre_model, states, disturbance=(0.0, 0.0), age=0.0):
    """Axle forces of each group about states at the nodes, shape (N + 1, 6), or one that lasts."""
    settings, work = settings_of(BMW, ControllerConfig(tyre_model=tyre_model)), record(WORK)
    grid, w = settings["grid"][0], work[0]
    w["before"][: grid["nodes"] + 1], w["group_speed"][:] = states, 15.0
    w["disturbance"][:], w["age"] = disturbance, age
    linearise(w, settings[0])
    return w["forces"][: grid["groups"]].copy(), grid["force_times"][: grid["groups"]]


def test_linear_car_has_the_same_line_everywhere():
    lines, times = lines_of("linear", [0.0, 0.0, 0.05, 0.3, 0.1, 0.1])
    assert lines == pytest.approx(np.tile([LINEAR.stiffness_f, 0.0, LINEAR.stiffness_r, 0.0, 0.0], (len(times), 1)))


def test_disturbance_is_added_to_the_lines():
    lines, _ = lines_of("affine", np.zeros(6), (100.0, -50.0))
    assert lines[0, [1, 3]] == pytest.approx([100.0, -50.0])


def test_lines_follow_the_prediction_in_time():
    nodes = settings_of(BMW, ControllerConfig())["grid"][0]
    times = np.concatenate([[0.0], nodes["times"][: nodes["nodes"]]])
    states = np.zeros((len(times), 6))
    states[:, 4] = 0.04 * times  # steering more and more: the front tyre softens
    lines, at = lines_of("affine", states)
    assert np.all(np.diff(lines[:, 0]) < 0.0)
    expected = [tangent(0.04 * t, 0.0, AFFINE.stiffness_f, AFFINE.load_f, AFFINE)[0] for t in at]
    assert lines[:, 0] == pytest.approx(expected)
    late, _ = lines_of("affine", states, age=9.0)  # beyond its end the prediction lasts
    assert late[:, 0] == pytest.approx(np.full(len(at), late[0, 0]))


def advanced(start, roll, motion, disturbance, commands, period, car):
    x, rolled = start.copy(), np.array(roll)
    for command in commands:
        advance(x, rolled, motion, disturbance, command, period, car, np.empty((6, 6)))
    return x, rolled


@pytest.mark.parametrize("car", [LINEAR, AFFINE], ids=["linear", "affine"])
@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_advance_is_the_nonlinear_model(car, lag):
    car = car._replace(lag=lag)
    start, commands, v = np.array([0.3, 0.02, 0.01, 0.1, 0.03, 0.03]), np.array([0.034, 0.025]), 15.0
    there, _ = advanced(start, np.zeros(2), (v, 0.15), (80.0, -30.0), commands, 0.02, car)
    x = start[:5].copy()
    for command in commands:
        if lag == 0.0:
            x[4] = command

        def rates(_, y, command=command):
            front, rear = slip_angles(y[2], y[3], y[4], v, car)
            f = axle_force(front, car.stiffness_f, car.load_f, car) + 80.0
            r = axle_force(rear, car.stiffness_r, car.load_r, car) - 30.0
            steering = (command - y[4]) / lag if lag else 0.0
            return [
                v * (y[1] + y[2]), y[3] - 0.15, (f + r) / (car.mass * v) - y[3],
                (car.l_f * f - car.l_r * r) / car.yaw_inertia, steering,
            ]  # fmt: skip

        x = solve_ivp(rates, (0.0, 0.02), x, rtol=1e-10, atol=1e-12).y[:, -1]
    assert there[:5] == pytest.approx(x, abs=1e-7)
    assert there[5] == commands[-1]


def test_actuator_rate_is_limited_on_the_way():
    there, _ = advanced(np.zeros(6), np.zeros(2), (15.0, 0.0), (0.0, 0.0), [1.0], 0.02, LINEAR)
    assert there[4] == pytest.approx(0.02 * BMW.steer_rate_limit)


@pytest.mark.parametrize("speed", [5.0, 15.0, 30.0])
def test_steady_gain_is_the_limit_of_the_model(speed):
    a, b, _ = continuous(BMW, speed)
    _, gamma = np.linalg.solve(a[2:, 2:], -b[2:])
    assert steady_gain(speed, LINEAR) == pytest.approx(speed * gamma, rel=1e-9)


@pytest.mark.parametrize("period", [0.005, 0.01, 0.02, 0.04, 0.05, 0.1])
def test_grid_covers_the_horizon(period):
    level, block, group = grid(period)
    steps = period * 2.0**level
    assert abs(steps.sum() - HORIZON) <= steps.max()
    assert steps.max() <= max(COARSEST_STEP * 1.5, period)
    assert len(group) == len(block) == len(level)
    assert set(np.diff(block)) <= {0, 1}
    assert set(np.diff(group)) <= {0, 1}
    assert np.all(np.diff(level) >= 0)
    assert all(len(set(level[group == g])) == 1 for g in range(group[-1] + 1))


def test_below_the_slowest_speed_the_model_stands_still():
    assert np.array_equal(block(0.0), block(SLOWEST))


@pytest.mark.parametrize("lag", [0.0, 1e-3])
def test_wheels_without_lag_turn_as_they_are_told(lag):
    """Whatever the rest of the car does, realised and commanded angle stay one."""
    state = np.array([0.3, 0.02, -0.01, 0.2, 0.05, 0.05, 0.4, 0.0, 0.0, 0.0])
    assert (block(15.0, AFFINE._replace(lag=lag)) @ state)[4:6].tolist() == [0.4, 0.4]


@pytest.mark.parametrize("balance", [0.6, 1.0, 1.6])
def test_forces_that_lag_are_those_of_slip_angles_a_little_earlier(balance):
    """F = C (alpha - lag alpha') put into Newton's two equations by numpy, for cars that under- and oversteer, too."""
    speed, late = 18.0, AFFINE._replace(stiffness_f=balance * AFFINE.stiffness_f)
    at_once, lagging = block(speed, late._replace(relaxation=0.0)), block(speed, late)
    lag = tyre_lag(speed, late.stiffness_f + late.stiffness_r, late)
    assert lag > 0.0
    slips = np.array([[-1.0, -late.l_f / speed, 1.0], [-1.0, late.l_r / speed, 0.0]])  # of beta, gamma, delta
    forces = np.array([[1.0 / (late.mass * speed), late.l_f / late.yaw_inertia],
                       [1.0 / (late.mass * speed), -late.l_r / late.yaw_inertia]]).T  # fmt: skip
    lost = lag * forces @ (np.array([[late.stiffness_f], [late.stiffness_r]]) * slips)
    implicit = np.eye(2) + lost[:, :2]  # x' = f - lost (beta', gamma', delta')
    expected = np.linalg.solve(implicit, at_once[2:4] - lost[:, 2:] @ at_once[4:5])
    assert lagging[2:4] == pytest.approx(expected, rel=1e-9, abs=1e-12)
