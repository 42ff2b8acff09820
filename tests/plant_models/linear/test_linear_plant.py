import math
import subprocess
import sys
from dataclasses import astuple, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sidestep import plant_models
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.linear.bicycle import continuous, discretise
from sidestep.plant_models.linear.plant import LinearPlant, advance, steered
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.speed_control import SPEED_GAIN, longitudinal_acceleration
from sidestep.plant_models.vehicle.parameters import VehicleParameters, vehicle_presets

BMW = VehicleParameters.preset("bmw-320i")
CARS = [VehicleParameters.preset(name) for name in vehicle_presets()]


def drive(plant: LinearPlant, start: VehicleState, steer: float, speed: float, duration: float) -> list[VehicleState]:
    states = [plant.reset(start)]
    for _ in range(round(duration / 0.02)):
        states.append(plant.step(SteeringCommand(states[-1].time, steer, speed), 0.02))
    return states


# The lateral dynamics


@pytest.mark.parametrize("speed", [2.0, 15.0, 40.0])
def test_at_constant_speed_it_is_the_papers_model(speed):
    a, b, _ = continuous(BMW, speed)
    a_k, b_k = discretise(a[2:, 2:], b[2:, None], 0.02)
    start = VehicleState(v_x=speed, v_y=0.02 * speed, yaw_rate=-0.1, steer_angle=0.03)
    lateral = np.array([0.02, -0.1])
    for state in drive(LinearPlant(BMW), start, 0.03, speed, 1.0)[1:]:
        lateral = a_k @ lateral + b_k[:, 0] * 0.03
        assert (state.v_y / speed, state.yaw_rate) == pytest.approx(tuple(lateral), abs=2e-6)
        assert state.v_x == speed


def test_pose_speed_and_steering_against_an_independent_integration():
    """Everything at once, below the rate limit: lag of the steering, speed change, turning."""
    car = replace(BMW, steer_rate_limit=100.0)
    start = VehicleState(1.0, 5.0, -3.0, 0.5, 14.0, 0.1, 0.05, -0.01)

    def rates(_, state):
        _, _, yaw, v_x, v_y, yaw_rate, steer = state
        front = car.cornering_stiffness_front * (steer - v_y / v_x - car.l_f * yaw_rate / v_x)
        rear = car.cornering_stiffness_rear * (-v_y / v_x + car.l_r * yaw_rate / v_x)
        return [
            v_x * math.cos(yaw) - v_y * math.sin(yaw),
            v_x * math.sin(yaw) + v_y * math.cos(yaw),
            yaw_rate,
            SPEED_GAIN * (13.0 - v_x),
            (front + rear) / car.mass - v_x * yaw_rate,
            (car.l_f * front - car.l_r * rear) / car.yaw_inertia,
            (0.04 - steer) / car.steer_time_constant,
        ]

    solution = solve_ivp(rates, (1.0, 3.0), astuple(start)[1:], method="DOP853", rtol=1e-12, atol=1e-12)
    end = drive(LinearPlant(car), start, 0.04, 13.0, 2.0)[-1]
    np.testing.assert_allclose(astuple(end)[1:], solution.y[:, -1], atol=2e-7)
    assert end.time == pytest.approx(3.0)


def test_halving_the_substep_divides_the_error_by_sixteen():
    parameters = LinearPlant(BMW)._parameters

    def end(substeps):
        motion = np.array([0.0, 0.0, 0.0, 15.0, 0.3, -0.2])
        advance(motion, 0.01, 0.02, (14.5, math.nan), 0.2, substeps, parameters)
        return motion

    truth = end(2000)
    errors = [np.abs(end(substeps) - truth).max() for substeps in (10, 20, 40)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.15)


@pytest.mark.parametrize("car", CARS, ids=lambda car: car.name)
@pytest.mark.parametrize("speed", [0.3, 1.4, 15.0])
def test_steady_turns_are_kinematic_when_slow_and_understeer_when_fast(car, speed):
    end = drive(LinearPlant(car), VehicleState(v_x=speed), 0.02, speed, 5.0)[-1]
    gradient = (car.l_r / car.cornering_stiffness_front - car.l_f / car.cornering_stiffness_rear) * car.mass
    if speed >= 1.5:
        assert end.yaw_rate == pytest.approx(0.02 * speed / (car.wheelbase + gradient / car.wheelbase * speed**2))
    else:
        assert end.yaw_rate == pytest.approx(0.02 * speed / car.wheelbase, rel=2e-3)
        assert end.v_y == pytest.approx(car.l_r * end.yaw_rate, rel=0.05)


def test_nothing_moves_at_standstill():
    states = drive(LinearPlant(BMW), VehicleState(x=1.0, y=2.0, yaw=0.5), 0.5, 0.0, 2.0)
    assert states[-1] == replace(states[0], time=states[-1].time, steer_angle=states[-1].steer_angle)
    assert states[-1].steer_angle == pytest.approx(0.5)


def test_braking_to_a_stop_in_a_bend_is_calm():
    states = drive(LinearPlant(BMW), VehicleState(v_x=15.0), 0.05, 0.0, 12.0)
    values = np.array([astuple(state) for state in states])
    assert np.abs(values[:, 6]).max() < 0.05 * 15.0 / BMW.wheelbase
    slow = [state for state in states if 1e-3 < state.v_x < 1.5]
    for state in slow:
        # What is left is the time that the tyres take to follow: a fiftieth of a second at 1.5 m/s.
        assert state.yaw_rate == pytest.approx(0.05 * state.v_x / BMW.wheelbase, abs=1.5e-3)
    assert states[-1].v_x == pytest.approx(0.0, abs=1e-6)
    assert states[-1].yaw_rate == pytest.approx(0.0, abs=1e-6)


def test_left_and_right_are_mirror_images_to_the_bit():
    left, right = (
        np.array([astuple(state) for state in drive(LinearPlant(BMW), VehicleState(v_x=12.0), steer, 13.0, 2.0)])
        for steer in (0.07, -0.07)
    )
    np.testing.assert_array_equal(left, right * np.array([1, 1, -1, -1, 1, -1, -1, -1]))


def test_turning_the_world_turns_the_drive():
    here = drive(LinearPlant(BMW), VehicleState(v_x=12.0), 0.05, 13.0, 3.0)[-1]
    there = drive(LinearPlant(BMW), VehicleState(x=100.0, y=-50.0, yaw=2.0, v_x=12.0), 0.05, 13.0, 3.0)[-1]
    turned = complex(here.x, here.y) * complex(math.cos(2.0), math.sin(2.0))
    assert (there.x - 100.0, there.y + 50.0) == pytest.approx((turned.real, turned.imag), abs=1e-10)
    assert there.yaw - 2.0 == pytest.approx(here.yaw, abs=1e-12)


# The actuators

angles = st.floats(-1.0, 1.0)
times = st.floats(0.0, 2.0)
time_constants = st.one_of(st.just(0.0), st.floats(0.01, 0.5))


@settings(deadline=None, derandomize=True)
@given(angles, angles, times, times, time_constants, st.floats(0.05, 2.0))
def test_steering_in_two_stretches_is_steering_in_one(steer, command, first, second, time_constant, rate):
    middle = steered(steer, command, first, time_constant, rate)
    whole = steered(steer, command, first + second, time_constant, rate)
    assert steered(middle, command, second, time_constant, rate) == pytest.approx(whole, abs=1e-12)
    assert abs(middle - steer) <= rate * first + 1e-12
    assert min(steer, command) - 1e-12 <= middle <= max(steer, command) + 1e-12


def test_steering_obeys_its_differential_equation():
    lag, rate, command = 0.05, 0.4, 0.1
    for elapsed in np.linspace(0.005, 0.5, 50):
        before, now, after = (steered(0.0, command, elapsed + d, lag, rate) for d in (-1e-6, 0.0, 1e-6))
        assert (after - before) / 2e-6 == pytest.approx(min((command - now) / lag, rate), abs=1e-5)


def test_without_lag_the_angle_ramps_and_stays():
    car = replace(BMW, steer_time_constant=0.0)
    states = drive(LinearPlant(car), VehicleState(v_x=10.0), 0.1, 10.0, 0.5)
    expected = [min(BMW.steer_rate_limit * state.time, 0.1) for state in states]
    np.testing.assert_allclose([state.steer_angle for state in states], expected, atol=1e-12)


def test_steering_stops_at_its_limit():
    states = drive(LinearPlant(BMW), VehicleState(v_x=1.0), 3.0, 1.0, 4.0)
    assert states[-1].steer_angle == pytest.approx(BMW.steer_limit, abs=1e-9)
    assert max(state.steer_angle for state in states) <= BMW.steer_limit


def test_an_offset_is_added_to_every_command():
    crooked = drive(LinearPlant(BMW, steer_offset=0.02), VehicleState(v_x=10.0), 0.03, 10.0, 1.0)
    straight = drive(LinearPlant(BMW), VehicleState(v_x=10.0), 0.05, 10.0, 1.0)
    assert crooked == straight


def test_speed_control_law():
    for speed, target, expected in ((10.0, 10.5, 1.0), (10.0, 9.0, -2.0), (10.0, 20.0, 3.0), (10.0, 0.0, -8.0)):
        assert longitudinal_acceleration(speed, target, BMW) == expected


def test_full_braking_then_an_exponential_end():
    states = drive(LinearPlant(BMW), VehicleState(v_x=15.0), 0.0, 0.0, 4.0)
    switch = (15.0 - 4.0) / 8.0  # at 4 m/s the law asks for less than full braking
    for state in states:
        expected = 15.0 - 8.0 * state.time if state.time < switch else 4.0 * math.exp(-2.0 * (state.time - switch))
        assert state.v_x == pytest.approx(expected, abs=1e-5)


# The life cycle


def test_a_command_that_is_not_finite_leaves_the_last_one_in_force():
    def run(steer, speed):
        plant = LinearPlant(BMW)
        plant.reset(VehicleState(v_x=10.0))
        plant.step(SteeringCommand(0.0, 0.05, 11.0), 0.02)
        return plant.step(SteeringCommand(0.02, steer, speed), 0.3)

    expected = run(0.05, 11.0)
    assert run(math.nan, 11.0) == run(0.05, math.nan) == run(math.inf, -math.inf) == expected


def test_before_any_finite_command_the_car_goes_on_as_reset():
    plant = LinearPlant(BMW)
    plant.reset(VehicleState(v_x=10.0, steer_angle=0.04))
    state = plant.step(SteeringCommand(0.0, math.nan, math.nan), 1.0)
    assert (state.v_x, state.steer_angle) == (10.0, 0.04)


def test_reset_says_where_the_car_really_is():
    asked = VehicleState(3.0, 1.0, 2.0, 0.5, 10.0, 0.1, 0.2, 2.0)
    assert LinearPlant(BMW).reset(asked) == replace(asked, steer_angle=BMW.steer_limit)


def test_reset_forgets_the_drive_before():
    plant = LinearPlant(BMW)
    first = drive(plant, VehicleState(v_x=15.0), 0.05, 16.0, 0.4)
    drive(plant, VehicleState(v_x=3.0, yaw=1.0), -0.2, 1.0, 0.4)
    assert drive(plant, VehicleState(v_x=15.0), 0.05, 16.0, 0.4) == first


@pytest.mark.parametrize("name", ["x", "v_x", "steer_angle", "time"])
def test_a_start_that_is_not_finite_is_refused(name):
    with pytest.raises(PlantError, match="not finite"):
        LinearPlant(BMW).reset(replace(VehicleState(), **{name: math.nan}))


def test_misuse():
    plant = LinearPlant(BMW)
    with pytest.raises(PlantError, match="before reset"):
        plant.step(SteeringCommand(0.0, 0.0, 0.0), 0.02)
    plant.reset(VehicleState())
    for dt in (0.0, -0.1, math.nan, math.inf):
        with pytest.raises(InputError, match="dt"):
            plant.step(SteeringCommand(0.0, 0.0, 0.0), dt)


@pytest.mark.parametrize("dt", [1e-13, 1e-3, 2.0000001e-3, 0.05])
def test_any_step_is_made(dt):
    plant = LinearPlant(BMW)
    plant.reset(VehicleState(v_x=10.0))
    assert plant.step(SteeringCommand(0.0, 0.0, 10.0), dt).x == pytest.approx(10.0 * dt, rel=1e-12)


def test_a_car_that_is_thrown_out_of_bounds_ends_the_drive():
    plant = LinearPlant(BMW)
    plant.reset(VehicleState(v_x=15.0, v_y=1e307))
    with pytest.raises(PlantError, match="bounds"), np.errstate(all="ignore"):
        plant.step(SteeringCommand(0.0, 0.0, 15.0), 1.0)


def test_every_public_name_is_there_and_no_other():
    for name in plant_models.__all__:
        assert getattr(plant_models, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'FluxPlant'"):
        plant_models.FluxPlant  # noqa: B018 (the access is the test)


def test_importing_the_models_loads_nothing_heavy():
    code = "import sys, sidestep.plant_models as m; m.LinearPlant; print(*{n.partition('.')[0] for n in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"mujoco", "fmpy", "can", "cantools", "matplotlib", "msgspec"} & set(loaded)
