"""Plants of rising fidelity differ where theory says, and by the kind of difference that it says."""

from dataclasses import replace

import pytest

from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.catalogue import Manoeuvre, Ramp, Sine
from sidestep.validation.manoeuvres.open_loop import Response, drive
from sidestep.validation.model_error.theil import theil
from sidestep.validation.report.compare.rating import rate

CAR = VehicleParameters.preset("bmw-320i")


def driven(car: VehicleParameters, model: str, manoeuvre: Manoeuvre) -> Response:
    with native_plant(car, model=model) as plant:
        return drive(plant, manoeuvre, CAR)


def yaw_ratings(cars: list[tuple[VehicleParameters, str]], manoeuvres: list[Manoeuvre]) -> list[float]:
    """Overall rating of the second plant against the first in each manoeuvre."""
    pairs = [[driven(car, model, m)["yaw_rate"] for car, model in cars] for m in manoeuvres]
    return [rate(a, b).overall for a, b in pairs]


def test_load_sensitivity_shows_in_hard_turns_as_a_gain():
    """Outer wheels gain less than inner ones lose; without the sensitivity two tracks turn as one."""
    steps = [Manoeuvre("step", Ramp(), 20.0, a, 4.0) for a in (1.0, 7.0)]
    plain = CAR.on_tyres(CAR.tyre.without_load_sensitivity())
    gentle, hard = yaw_ratings([(CAR, "single-track"), (CAR, "double-track")], steps)
    without = yaw_ratings([(plain, "single-track"), (plain, "double-track")], steps)[1]
    assert gentle > 0.94
    assert hard < gentle - 0.03
    assert without > hard + 0.02
    pair = [driven(CAR, model, steps[1])["yaw_rate"] for model in ("single-track", "double-track")]
    split = theil(*pair)
    assert split.bias + split.variance > 0.6


def test_relaxation_shows_when_slow_and_quick_as_a_lag_and_a_loss():
    """Its time constant is the relaxation length over the speed."""
    short = CAR.with_(tyre=replace(CAR.tyre, relaxation_y=0.1))
    sines = [Manoeuvre("sine", Sine(f, cycles=6.0), v, 1.5, 3.5) for v, f in ((8.0, 2.0), (8.0, 0.4), (32.0, 2.0))]
    pairs = [[driven(car, "single-track", m)["yaw_rate"] for car in (short, CAR)] for m in sines]
    ratings = [rate(a, b).overall for a, b in pairs]
    assert ratings[0] < min(ratings[1:]) - 0.03
    split = theil(*pairs[0])  # smaller and later, about the same mean
    assert split.bias < 0.01
    assert min(split.variance, split.covariance) > 0.3


def test_roll_shows_near_its_resonance_in_the_lateral_acceleration():
    """The centre of gravity swings over the tyres: by height times roll acceleration."""
    low = CAR.with_(cg_height=0.05)
    sines = [Manoeuvre("sine", Sine(f, cycles=8.0), 20.0, 1.5, 5.0) for f in (0.3, 1.5)]
    pairs = [[driven(car, "double-track", m)["lateral_acceleration"] for car in (low, CAR)] for m in sines]
    slow, quick = (rate(a, b).overall for a, b in pairs)
    assert quick < slow - 0.2
    assert theil(*pairs[0]).u < 0.5 * theil(*pairs[1]).u


@pytest.mark.parametrize("model", ["single-track", "double-track"])
def test_all_agree_in_a_gentle_turn(model):
    turn = Manoeuvre("step", Ramp(), 15.0, 0.5, 4.0)
    linear = driven(CAR, "linear", turn)["yaw_rate"]
    assert rate(linear, driven(CAR, model, turn)["yaw_rate"]).overall > 0.9
