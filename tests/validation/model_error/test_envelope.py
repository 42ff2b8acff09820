"""Predictions against the plant that they are the model of, frames, crossing, and the envelope of a small grid."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sidestep.fmu.importing.plant import FmuPlant
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.manoeuvres.open_loop import drive
from sidestep.validation.model_error import envelope as module
from sidestep.validation.model_error.envelope import (
    FRICTIONS,
    Envelope,
    cell_errors,
    cell_manoeuvres,
    crossing,
    envelope,
    frictions_of,
    open_loop_scenario,
    open_with_friction,
    tyre_limit,
)
from sidestep.validation.model_error.envelope_figure import envelope_chart, limits_chart
from sidestep.validation.model_error.prediction_error import prediction_errors, road_states, statistics
from sidestep.validation.model_error.prediction_models import MODELS
from sidestep.validation.model_error.step_size import step_halving

CAR = VehicleParameters.preset("bmw-320i")


@pytest.mark.parametrize("curvature", [0.0, 0.02, -0.02])
def test_the_linear_model_predicts_the_linear_plant(curvature):
    """What is left is small angles: the fourth power of the angle turned, relative to the road."""
    errors = []
    for acceleration in (1.0, 2.0):
        (step, *_) = cell_manoeuvres(20.0, acceleration + 400.0 * curvature, 400.0 * curvature)
        response = drive(LinearPlant(CAR), step, CAR, commands=5)
        errors.append(np.abs(prediction_errors("linear", response, CAR, curvature=curvature)).max(axis=(0, 1)))
    assert errors[0][0] < 0.01
    assert errors[1][0] < 0.03
    assert errors[1][2:] == pytest.approx([0.0, 0.0], abs=2e-3)  # sideslip and yaw rate know no frame


def test_euler_is_worse_at_small_angles_and_unstable_when_slow():
    manoeuvres = cell_manoeuvres(20.0, 1.0, 0.0), cell_manoeuvres(4.0, 1.0, 0.0)
    with LinearPlant(CAR) as plant:
        fast, slow = (dict(zip(MODELS, cell_errors(plant, CAR, 1.0, m), strict=True)) for m in manoeuvres)
    assert fast["euler"] > 5.0 * fast["linear"]
    assert slow["euler"] > 100.0  # 2 / |pole| = 0.037 s < 0.05 s
    assert slow["linear"] < 0.1


def test_the_affine_model_follows_the_magic_formula_where_the_linear_one_cannot():
    """Both start from the same stiffness: what is left of the linear model's error is the bend of the tyres' curve."""
    with native_plant(CAR) as plant:
        for a_y, share in ((2.0, 0.3), (6.0, 0.45)):
            linear, _, affine = cell_errors(plant, CAR, 1.0, cell_manoeuvres(25.0, a_y, 0.0)).tolist()
            assert affine < share * linear


def test_a_circle_lies_still_in_its_own_frame_and_curves_away_in_the_straight_one():
    radius, speed = 50.0, 10.0
    angle = np.linspace(0.3, 1.3, 41)
    signals = {
        "x": 3.0 + radius * np.sin(angle), "y": -2.0 - radius * np.cos(angle), "yaw": angle,
        "v_x": np.full(41, speed), "v_y": np.full(41, 0.5), "yaw_rate": np.full(41, speed / radius),
    }  # fmt: skip
    window = {name: values[None] for name, values in signals.items()}
    own, straight = road_states(window, 1.0 / radius)[0], road_states(window, 0.0)[0]
    assert own[:, :2] == pytest.approx(np.zeros((41, 2)), abs=1e-12)
    assert straight[-1, :2] == pytest.approx([radius * (1.0 - math.cos(1.0)), 1.0])
    assert own[0, 2:] == pytest.approx([0.05, 0.2])
    mirrored = {name: -v if name in ("y", "yaw", "v_y", "yaw_rate") else v for name, v in window.items()}
    assert road_states(mirrored, -1.0 / radius)[0] == pytest.approx(-own, abs=1e-12)


def test_statistics_pool_the_drives():
    errors = [np.full((3, 2, 4), -1.0), np.full((1, 2, 4), 3.0)]
    found = statistics(errors)
    assert found.p50 == pytest.approx(np.ones((2, 4)))
    assert found.max == pytest.approx(np.full((2, 4), 3.0))
    assert found.rms == pytest.approx(np.full((2, 4), math.sqrt(3.0)))


def test_crossing_is_the_first_and_linear_between():
    x = np.array([1.0, 2.0, 3.0, 4.0])
    assert crossing(x, np.array([0.1, 0.3, 0.1, 0.1]), 0.2) == pytest.approx(1.5)
    assert crossing(x, np.array([0.4, 1.0, 1.0, 1.0]), 0.2) == pytest.approx(0.5)
    assert crossing(x, np.full(4, 0.1), 0.2) == 4.0
    assert crossing(x, np.array([0.1, 0.15, np.nan, 0.1]), 0.2) == 2.0


def test_tyre_limit_scales_with_friction():
    limits = [tyre_limit(CAR, friction) for friction in FRICTIONS]
    assert limits == pytest.approx([friction * limits[0] for friction in FRICTIONS], rel=1e-3)
    assert 9.0 < limits[0] < 11.0


@pytest.fixture(scope="module")
def small() -> Envelope:
    return envelope(['plant.kind="single-track"'], jobs=1, speeds=(10.0, 25.0), shares=(0.2, 0.5, 0.8))


def test_envelope_of_a_small_grid(small):
    assert small.cells == 18
    assert small.errors.shape == (2, 3, 3, 2, 3)
    assert np.isfinite(small.errors).all()
    assert (np.diff(small.errors[0, 0], axis=-1) > 0.0).all()  # more is worse
    limits = small.largest()
    assert (limits[:, 2] >= limits[:, 0]).all()  # the affine model goes further
    assert (limits[1, :, :, 0] >= limits[0, :, :, 0]).all()  # slow: the bend takes the angle away
    assert (limits <= small.accelerations[:, -1][:, None] + 1e-9).all()


def test_tables_hold_the_narrower_road(small):
    tables = small.as_tables()
    assert tables["max_lateral_acceleration"]["affine"] == pytest.approx(small.largest()[:, 2].min(axis=0))
    assert tables["friction"] == [1.0, 0.6, 0.3]
    assert np.array(tables["p95_error"]["curved"]["euler"]) == pytest.approx(small.errors[1, 1])


def test_charts_have_a_panel_a_model_and_friction(small):
    chart = envelope_chart(small, CAR)
    assert len([axes for axes in chart.axes if axes.get_title(loc="center").startswith("friction")]) == 3
    assert len(chart.axes) == 9 + 1
    assert len(limits_chart(small).axes) == 3
    assert len(envelope_chart(replace(small, errors=np.full_like(small.errors, np.nan)), CAR, "curved").axes) == 10


def test_a_plant_that_gives_up_leaves_a_gap(monkeypatch):
    def give_up(*_):
        raise PlantError("spun")

    monkeypatch.setattr(module, "cell_errors", give_up)
    found = envelope(['plant.kind="linear"'], jobs=1, speeds=(10.0,), shares=(0.5,))
    assert np.isnan(found.errors).all()
    assert (found.largest() == 0.0).all()
    assert found.frictions.tolist() == [1.0]


def test_an_fmu_is_driven_on_other_friction_if_it_has_the_parameter():
    with native_plant(CAR) as plant, native_plant(CAR, model="linear") as linear:
        files = [str(plant.path), str(linear.path)]
    scenarios = [open_loop_scenario([f'plant.kind="{file}"']) for file in files]
    assert [frictions_of(scenario) for scenario in scenarios] == [FRICTIONS, FRICTIONS[:1]]
    (step, *_) = cell_manoeuvres(20.0, 8.0, 0.0)
    reached = []
    for friction in FRICTIONS:
        with open_with_friction(scenarios[0], friction) as plant:
            reached.append(drive(plant, step, CAR)["lateral_acceleration"].max())
    assert reached[2] < tyre_limit(CAR, 0.3) * 1.05 < reached[0]


def test_what_stands_before_an_fmu_lets_its_friction_through():
    with native_plant(CAR) as plant, native_plant(CAR, model="linear") as linear:
        files = [str(plant.path), str(linear.path)]
    scenarios = [open_loop_scenario([f'plant.kind="{file}"', "plant.delay=0.02"]) for file in files]
    assert [frictions_of(scenario) for scenario in scenarios] == [FRICTIONS, FRICTIONS[:1]]


def test_friction_of_an_fmu_is_set_or_refused(foreign):
    with native_plant(CAR) as plant:
        file = plant.path
    with FmuPlant.from_file(file, friction=0.6) as plant:
        assert plant.mapping.parameters["friction"] == 0.6
    file, table = foreign
    with pytest.raises(InputError, match=r"plant.friction: 0.6: foreign.fmu has no parameter friction; allowed: 1.0"):
        open_plant(open_loop_scenario([f'plant.kind="{file}"', f'plant.map="{table}"', "plant.friction=0.6"]))


def test_numerics_are_below_a_percent_of_the_model_error():
    with native_plant(CAR) as plant:
        found = step_halving(plant, "single-track", CAR, 15.0, 4.0)
    assert [s.model for s in found] == list(MODELS)
    assert all(s.passed for s in found)
    assert all(0.0 < s.numerical_error < s.model_error for s in found)
