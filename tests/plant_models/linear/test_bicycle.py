import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from sidestep.plant_models.linear.bicycle import continuous, discretise, euler
from sidestep.plant_models.vehicle.parameters import VehicleParameters, vehicle_presets

BMW = VehicleParameters.preset("bmw-320i")
CARS = [VehicleParameters.preset(name) for name in vehicle_presets()]

steady = settings(deadline=None, derandomize=True, max_examples=30)


def understeer_gradient(car: VehicleParameters) -> float:
    """K of the steady state yaw rate v / (L + K v^2) per steering angle, in [s^2/m]."""
    c_f, c_r = car.cornering_stiffness_front, car.cornering_stiffness_rear
    return car.mass * (car.l_r * c_r - car.l_f * c_f) / (car.wheelbase * c_f * c_r)


@pytest.mark.parametrize("car", CARS, ids=lambda car: car.name)
@pytest.mark.parametrize("speed", [3.0, 15.0, 40.0])
def test_steady_state_yaw_rate(car, speed):
    a, b, _ = continuous(car, speed)
    beta, yaw_rate = -np.linalg.solve(a[2:, 2:], b[2:])
    gain = speed / (car.wheelbase + understeer_gradient(car) * speed**2)
    assert yaw_rate == pytest.approx(gain, rel=1e-9)
    rear_slip = car.mass * car.l_f * speed * yaw_rate / (car.wheelbase * car.cornering_stiffness_rear)
    assert beta == pytest.approx(car.l_r * yaw_rate / speed - rear_slip, rel=1e-9)


def test_the_bmw_is_neutral():
    assert understeer_gradient(BMW) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("speed", "pole"), [(15.0, -14.3), (10.0, -21.5), (5.0, -43.0)])
def test_poles_of_the_bmw(speed, pole):
    poles = np.linalg.eigvals(continuous(BMW, speed)[0][2:, 2:])
    # Neutral steer: a nearly double pole, which the rounded stiffnesses split by half a percent.
    np.testing.assert_allclose(poles.real, pole, rtol=0.01)


def test_driving_along_a_circle_at_its_curvature_keeps_the_offset():
    """The equilibrium on a circle of the first-order road frame: yaw rate = kappa v (1 + kappa l) to first order."""
    speed, curvature, offset = 10.0, 0.01, 0.5
    a, b, c = continuous(BMW, speed, curvature)
    yaw_rate = speed * curvature * (1.0 + curvature * offset)
    beta_per_rate, steer_per_rate = np.linalg.solve(np.column_stack([a[2:, 2], b[2:]]), -a[2:, 3])
    beta = beta_per_rate * yaw_rate
    state = np.array([offset, -beta, beta, yaw_rate])
    np.testing.assert_allclose(a @ state + b * steer_per_rate * yaw_rate + c, 0.0, atol=1e-12)


def held_inputs(speed: float, curvature: float) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = continuous(BMW, speed, curvature)
    return a, np.column_stack([b, c])


@steady
@given(st.floats(2.0, 50.0), st.floats(-0.05, 0.05), st.floats(0.005, 0.3))
def test_discretisation_solves_the_differential_equation(speed, curvature, dt):
    a, inputs = held_inputs(speed, curvature)
    a_k, g_k = discretise(a, inputs, dt)
    x, w = np.array([0.3, -0.05, 0.02, 0.1]), np.array([0.03, 1.0])
    solution = solve_ivp(lambda _, x: a @ x + inputs @ w, (0.0, dt), x, method="DOP853", rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(a_k @ x + g_k @ w, solution.y[:, -1], rtol=1e-9, atol=1e-10)


@steady
@given(st.floats(2.0, 50.0), st.floats(0.005, 0.3))
def test_discretisation_is_the_exponential_and_its_integral(speed, dt):
    a, inputs = held_inputs(speed, 0.0)
    a_k, g_k = discretise(a, inputs, dt)
    np.testing.assert_allclose(a_k, expm(a * dt), rtol=1e-10, atol=1e-12)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    integral = sum(w * expm(a * (0.5 * dt * (1.0 + node))) for node, w in zip(nodes, weights, strict=True)) * 0.5 * dt
    np.testing.assert_allclose(g_k, integral @ inputs, rtol=1e-8, atol=1e-12)


@steady
@given(st.floats(2.0, 50.0), st.floats(0.005, 0.2))
def test_two_steps_are_one_of_twice_the_length(speed, dt):
    a, inputs = held_inputs(speed, 0.02)
    a_1, g_1 = discretise(a, inputs, dt)
    a_2, g_2 = discretise(a, inputs, 2.0 * dt)
    np.testing.assert_allclose(a_1 @ a_1, a_2, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(a_1 @ g_1 + g_1, g_2, rtol=1e-9, atol=1e-11)


def test_euler_is_the_first_order_of_the_exact_discretisation():
    a, inputs = held_inputs(15.0, 0.02)
    errors = []
    for dt in (1e-3, 5e-4, 2.5e-4):
        exact, approximate = discretise(a, inputs, dt), euler(a, inputs, dt)
        errors.append([np.abs(exact[i] - approximate[i]).max() for i in range(2)])
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    np.testing.assert_allclose(ratios, 4.0, rtol=0.02)


@pytest.mark.parametrize(("dt", "slowest"), [(0.1, 10.75), (0.05, 5.38)])
def test_euler_is_unstable_at_low_speed_where_the_exact_step_is_not(dt, slowest):
    def radius(step, speed):
        a, b, _ = continuous(BMW, speed)
        return np.abs(np.linalg.eigvals(step(a[2:, 2:], b[2:, None], dt)[0])).max()

    assert radius(euler, slowest - 0.1) > 1.0 > radius(euler, slowest + 0.1)
    for speed in (1.0, slowest, 40.0):
        assert radius(discretise, speed) < 1.0
