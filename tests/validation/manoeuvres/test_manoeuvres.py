"""Manoeuvres as data and as drives: what a shape promises, what a car does with it."""

import dataclasses

import numpy as np
import pytest

from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.catalogue import MANOEUVRES, Manoeuvre, Pulse, Ramp, RandomSteer, Sine, Sweep
from sidestep.validation.manoeuvres.open_loop import drive, steady_acceleration, steer_angle

CAR = VehicleParameters.preset("bmw-320i")
TIME = np.arange(0.0, 40.0, 1e-3)


def short(manoeuvre: Manoeuvre, seconds: float = 2.0) -> Manoeuvre:
    return dataclasses.replace(manoeuvre, duration=min(manoeuvre.duration, seconds))


@pytest.mark.parametrize("shape", [Ramp(), Sine(0.5), Sine(0.7, dwell=0.5), Sweep(0.1, 4.0, 40.0), Pulse()])
def test_shapes_start_at_rest_and_reach_one(shape):
    values = shape(TIME)
    assert values[0] == 0.0
    assert np.abs(values).max() == pytest.approx(1.0, abs=1e-4)
    assert np.abs(np.diff(values)).max() < 0.03  # no jumps


def test_sine_returns_to_zero_and_its_mean_is_that_of_the_dwell():
    plain, held = Sine(0.5)(TIME), Sine(0.7, dwell=0.5)(TIME)
    assert plain[TIME > 2.51].max() == 0.0
    assert np.trapezoid(plain, TIME) == pytest.approx(0.0, abs=1e-6)
    assert np.trapezoid(held, TIME) == pytest.approx(-0.5, abs=1e-3)
    assert np.count_nonzero(held < -1.0 + 1e-9) == pytest.approx(500, abs=3)


def test_sweep_passes_its_frequencies_evenly_in_the_logarithm():
    crossings = TIME[:-1][np.diff(np.sign(Sweep(0.1, 4.0, 40.0)(TIME))) != 0]
    rate = 0.5 / np.diff(crossings)
    expected = 0.1 * 40.0 ** ((crossings[1:] + crossings[:-1]) / 80.0)
    assert rate[3:] == pytest.approx(expected[3:], rel=0.03)


def test_random_steering_is_repeatable_in_its_band_and_of_its_size():
    values = RandomSteer(0.2, 3.0)(TIME)
    assert (values == RandomSteer(0.2, 3.0)(TIME)).all()
    assert values.std() == pytest.approx(1.0 / 3.0, rel=0.1)
    power = np.abs(np.fft.rfft(values)) ** 2
    frequency = np.fft.rfftfreq(len(values), 1e-3)
    outside = power[(frequency < 0.15) | (frequency > 3.2)].sum()
    assert outside < 0.01 * power.sum()
    assert not np.allclose(values, RandomSteer(0.2, 3.0, seed=1)(TIME))


@pytest.mark.parametrize("speed", [8.0, 20.0, 35.0])
def test_the_amplitude_is_the_steady_acceleration_of_the_linear_car(speed):
    response = drive(LinearPlant(CAR), Manoeuvre("step", Ramp(), speed, 2.0, 4.0), CAR)
    assert response["lateral_acceleration"][-1] == pytest.approx(2.0, rel=2e-3)
    assert steady_acceleration(steer_angle(2.0, speed, CAR), speed, CAR) == pytest.approx(2.0)


def test_a_drive_in_a_bend_starts_steady():
    response = drive(LinearPlant(CAR), Manoeuvre("bend", Ramp(), 15.0, 0.0, 1.0, bend=4.0), CAR)
    for name, value in (("yaw_rate", 4.0 / 15.0), ("lateral_acceleration", 4.0)):
        assert response[name] == pytest.approx(np.full(len(response["time"]), value), rel=1e-6)
    assert np.ptp(response["v_y"]) < 1e-9


@pytest.mark.parametrize("name", MANOEUVRES)
def test_every_manoeuvre_drives_and_its_mirror_image_mirrors(name):
    for manoeuvre in MANOEUVRES[name][:2]:
        left = drive(LinearPlant(CAR), short(manoeuvre), CAR)
        right = drive(LinearPlant(CAR), short(manoeuvre.mirrored()), CAR)
        assert left["time"][-1] == pytest.approx(min(manoeuvre.duration, 2.0))
        for signal in ("y", "yaw_rate", "steer_command", "lateral_acceleration"):
            assert left[signal] == pytest.approx(-right[signal], abs=1e-12)
        assert manoeuvre.name == name
        assert name in manoeuvre.label


def test_the_driver_holds_the_radius_while_the_speed_rises():
    (circle,) = MANOEUVRES["constant-radius"]
    response = drive(LinearPlant(CAR), circle, CAR)
    assert response["v_x"][-1] == pytest.approx(24.8, abs=0.3)
    radius = response["v_x"] / response["yaw_rate"]
    assert radius[len(radius) // 2 :] == pytest.approx(np.full(len(radius) - len(radius) // 2, 100.0), rel=0.02)


def test_coasting_neither_drives_nor_brakes():
    (coast,) = MANOEUVRES["coast"]
    assert drive(LinearPlant(CAR), short(coast), CAR)["v_x"] == pytest.approx(np.full(201, coast.speed))


def test_more_commands_follow_the_shape_more_closely():
    """The steering lags its command by half a command's time less: first order in it."""
    manoeuvre = Manoeuvre("sine", Sine(1.0), 20.0, 2.0, 2.0)
    ends = [drive(LinearPlant(CAR), manoeuvre, CAR, commands=n)["yaw_rate"][100] for n in (1, 2, 4)]
    assert (ends[1] - ends[0]) / (ends[2] - ends[1]) == pytest.approx(2.0, rel=0.05)
    held = drive(LinearPlant(CAR), manoeuvre, CAR, substeps=2)["yaw_rate"][100]
    assert held == pytest.approx(ends[0], abs=1e-9)
