"""From command to acceleration: as commanded, by the speed control where nothing is, and never backwards by braking."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.speed_control import (
    HOLD_SPEED,
    asked_acceleration,
    drive_asked,
    limited_acceleration,
)
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
BOTH = (math.nan, math.inf, -math.inf)


@given(st.floats(-5.0, 40.0), st.floats(0.0, 40.0), st.floats(-20.0, 20.0))
def test_a_commanded_acceleration_is_that_of_the_car_within_its_limits(speed, target, wanted):
    got = asked_acceleration(speed, target, wanted, 8.0, 3.0)
    assert -8.0 <= got <= (3.0 if wanted >= 0.0 else 8.0)
    if abs(speed) >= HOLD_SPEED or wanted >= 0.0:
        forward = speed >= 0.0 or wanted >= 0.0
        assert got == pytest.approx(min(max(wanted, -8.0), 3.0) * (1.0 if forward else -1.0))
    else:
        assert got * speed <= 0.0  # brakes act against the motion


@pytest.mark.parametrize("missing", BOTH)
def test_where_none_is_given_the_target_speed_counts(missing):
    assert asked_acceleration(10.0, 9.0, missing, 8.0, 3.0) == limited_acceleration(10.0, 9.0, 8.0, 3.0) == -2.0


def test_what_is_not_finite_leaves_in_force_what_was_held():
    held = 12.0, -3.0
    assert drive_asked(SteeringCommand(0.0, 0.0, math.nan), held) == held
    assert drive_asked(SteeringCommand(0.0, 0.0, math.inf, acceleration=1.0), held) == (12.0, 1.0)
    speed, acceleration = drive_asked(SteeringCommand(0.0, 0.0, 11.0), held)
    assert (speed, math.isnan(acceleration)) == (11.0, True)
    assert drive_asked(SteeringCommand(0.0, 0.0, 11.0, acceleration=0.5), held) == (11.0, 0.5)


@pytest.mark.parametrize(("plant", "error"), [(LinearPlant, 1e-9), (MujocoPlant, 0.08)])
@pytest.mark.parametrize(("wanted", "got"), [(-2.0, -2.0), (1.0, 1.0), (-30.0, -8.0), (30.0, 3.0), (0.0, 0.0)])
def test_our_plants_realise_it_whatever_the_target_speed_is(plant, error, wanted, got):
    with plant(BMW) as car:
        car.reset(VehicleState(v_x=15.0))
        states = [car.step(SteeringCommand(0.0, 0.0, 15.0, acceleration=wanted), 0.01) for _ in range(100)]
        assert states[-1].v_x == pytest.approx(15.0 + got, abs=error * max(1.0, abs(got)))


@pytest.mark.parametrize("plant", [LinearPlant, MujocoPlant])
@pytest.mark.parametrize("braking", [0.5, 3.0, 8.0])
def test_brakes_stop_the_car_hold_it_and_let_it_go(plant, braking):
    with plant(BMW) as car:
        car.reset(VehicleState(v_x=1.0))
        hold = SteeringCommand(0.0, 0.1, 0.0, acceleration=-braking)
        states = [car.step(hold, 0.01) for _ in range(round(100 * (1.0 / braking + 2.0)))]
        assert abs(states[-1].v_x) < 2e-3
        assert max(state.x for state in states) - states[-1].x < 0.02  # its tyres give a little, its wheels stand
        rest = [car.step(hold, 0.01) for _ in range(300)]
        assert math.hypot(rest[-1].x - states[-1].x, rest[-1].y - states[-1].y) < 2e-3
        gone = [car.step(SteeringCommand(0.0, 0.0, 15.0, acceleration=1.0), 0.01) for _ in range(100)]
        assert gone[-1].v_x == pytest.approx(1.0, abs=0.1)


def test_the_brakes_of_a_car_that_rolls_back_stop_it():
    with LinearPlant(BMW) as car:
        car.reset(VehicleState(v_x=-1.0))
        states = [car.step(SteeringCommand(0.0, 0.0, 0.0, acceleration=-2.0), 0.01) for _ in range(100)]
        assert max(state.v_x for state in states) <= 0.0
        assert states[-1].v_x > -1e-3
