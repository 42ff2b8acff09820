"""The tyre law against its own definitions, and the relaxing carcass against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.tyres.contact import relaxed_slip
from sidestep.plant_models.tyres.formula import cornering_stiffness, lateral_force, magic_formula
from sidestep.plant_models.tyres.parameters import TyreParameters

TYRE = TyreParameters()
P = TYRE.as_array()
LOADS = (500.0, 2000.0, 4000.0, 9000.0)

loads = st.floats(100.0, 10_000.0)
slips = st.floats(-0.8, 0.8)
frictions = st.floats(0.1, 1.2)


def peaks(load, friction=1.0):
    dfz = load / TYRE.nominal_load - 1.0
    x, y = TYRE.p_dx1 + TYRE.p_dx2 * dfz, TYRE.p_dy1 + TYRE.p_dy2 * dfz
    return x * load * friction, y * load * friction


@pytest.mark.parametrize("load", LOADS)
def test_slope_at_the_origin_is_the_slip_stiffness(load):
    h = 1e-6
    for friction in (0.3, 1.0):
        along = (magic_formula(h, 0.0, load, friction, P)[0] - magic_formula(-h, 0.0, load, friction, P)[0]) / (2 * h)
        across = (magic_formula(0.0, h, load, friction, P)[1] - magic_formula(0.0, -h, load, friction, P)[1]) / (2 * h)
        assert along == pytest.approx(TYRE.p_kx1 * load, rel=1e-6)
        assert across == pytest.approx(cornering_stiffness(load, P), rel=1e-6)


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_pure_slip_saturates_at_the_peak(load, friction):
    grid = np.linspace(0.0, 1.0, 2001)
    peak_x, peak_y = peaks(load, friction)
    assert max(magic_formula(k, 0.0, load, friction, P)[0] for k in grid) == pytest.approx(peak_x, rel=1e-4)
    assert max(magic_formula(0.0, a, load, friction, P)[1] for a in grid) == pytest.approx(peak_y, rel=1e-4)


@given(st.floats(-1.5, 1.5), st.just(0.0) | loads, frictions)
def test_lateral_force_is_that_of_the_whole_law_without_longitudinal_slip(alpha, load, friction):
    assert lateral_force(alpha, load, friction, P) == magic_formula(0.0, alpha, load, friction, P)[1]


@given(slips, slips, loads, frictions)
def test_forces_are_odd_in_their_own_slip_and_even_in_the_other(kappa, alpha, load, friction):
    fx, fy = magic_formula(kappa, alpha, load, friction, P)
    assert magic_formula(-kappa, alpha, load, friction, P) == (-fx, fy)
    assert magic_formula(kappa, -alpha, load, friction, P) == (fx, -fy)


@given(slips, st.floats(-1.5, 1.5), loads, frictions)
def test_slip_in_one_direction_only_takes_from_the_other(kappa, alpha, load, friction):
    fx, fy = magic_formula(kappa, alpha, load, friction, P)
    pure_x, _ = magic_formula(kappa, 0.0, load, friction, P)
    _, pure_y = magic_formula(0.0, alpha, load, friction, P)
    assert abs(fx) <= abs(pure_x)
    assert abs(fy) <= abs(pure_y)
    assert kappa * fx >= 0.0
    assert alpha * fy >= 0.0


@given(slips, slips, loads, frictions)
def test_combined_slip_stays_near_the_friction_ellipse(kappa, alpha, load, friction):
    """The published weights bulge by 13 % at small loads; independent peaks would by 41 %."""
    fx, fy = magic_formula(kappa, alpha, load, friction, P)
    peak_x, peak_y = peaks(load, friction)
    assert math.hypot(fx / peak_x, fy / peak_y) <= 1.14


@given(slips, slips, loads, frictions)
def test_friction_shrinks_the_forces_to_similar_ones(kappa, alpha, load, friction):
    reduced = magic_formula(kappa, alpha, load, friction, P)
    similar = magic_formula(kappa / friction, alpha / friction, load, 1.0, P)
    assert reduced == pytest.approx(tuple(friction * force for force in similar), rel=1e-9, abs=1e-9)


def test_load_transfer_costs_grip_and_stiffness():
    peak = [peaks(load)[1] / load for load in LOADS]
    stiffness = [cornering_stiffness(load, P) / load for load in LOADS]
    assert peak == sorted(peak, reverse=True)
    assert stiffness == sorted(stiffness, reverse=True)
    for alpha in (0.01, 0.05, 0.15):
        unequal = sum(magic_formula(0.0, alpha, load, 1.0, P)[1] for load in (2000.0, 6000.0))
        assert unequal < 2.0 * magic_formula(0.0, alpha, 4000.0, 1.0, P)[1]


@given(slips, slips, loads)
def test_without_load_sensitivity_is_the_published_subset(kappa, alpha, load):
    """CommonRoad vehicle models, appendix B, with its own numbers and without shifts, weights not below 0."""

    def sine(b, c, d, e, x):
        return d * np.sin(c * np.arctan(b * x - e * (b * x - np.arctan(b * x))))

    def weight(b, c, e, x):
        return max(np.cos(c * np.arctan(b * x - e * (b * x - np.arctan(b * x)))), 0.0)

    d_x, d_y = 1.1739 * load, 1.0489 * load
    pure_x = sine(22.303 * load / (1.6411 * d_x), 1.6411, d_x, 0.46403, kappa)
    pure_y = sine(21.92 * load / (1.3507 * d_y), 1.3507, d_y, -0.0074722, alpha)
    fx = pure_x * weight(13.276 * np.cos(np.arctan(-13.778 * kappa)), 1.2568, 0.65225, alpha)
    fy = pure_y * weight(7.1433 * np.cos(np.arctan(9.1916 * alpha)), 1.0719, -0.27572, kappa)
    got = magic_formula(kappa, alpha, load, 1.0, TYRE.without_load_sensitivity().as_array())
    assert got == pytest.approx((fx, fy), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("load", "friction"), [(0.0, 1.0), (-10.0, 1.0), (3000.0, 0.0)])
def test_no_load_or_no_friction_no_force(load, friction):
    assert magic_formula(0.3, 0.2, load, friction, P) == (0.0, 0.0)


@pytest.mark.parametrize("field", ["nominal_load", "p_dy1", "relaxation_y"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, True, "much"])
def test_bad_coefficients_are_named(field, value):
    with pytest.raises(InputError, match=f"vehicle.tyre.{field}"):
        TyreParameters(**{field: value})


def test_slip_builds_up_over_the_relaxation_length():
    """After one relaxation length 1 - 1/e of the slip is there; the step's error is of first order."""
    speed, slide, errors = 10.0, -0.1, []
    for steps in (100, 200, 400):
        deflection, alpha, dt = 0.0, 0.0, TYRE.relaxation_y / speed / steps
        for _ in range(steps):
            _, deflection, _, alpha = relaxed_slip(0.0, deflection, 0.0, slide, speed, dt, P)
        errors.append(alpha - math.atan(0.01 * (1.0 - math.exp(-1.0))))
    assert abs(errors[-1]) < 1e-5
    assert np.divide(errors[:-1], errors[1:]) == pytest.approx(2.0, abs=0.02)


def test_a_standing_tyre_is_a_damped_spring_with_an_end():
    end = pushed = 0.0
    for _ in range(10):
        _, end, _, pushed = relaxed_slip(0.0, end, 0.0, -0.1, 0.0, 1e-3, P)
    assert end == pytest.approx(10 * 0.1 * 1e-3)  # it follows the road
    _, end, _, held = relaxed_slip(0.0, end, 0.0, 0.0, 0.0, 1e-3, P)
    assert 0.0 < held < pushed  # and resists the motion itself
    for _ in range(10_000):
        _, end, _, _ = relaxed_slip(0.0, end, 0.0, -0.1, 0.0, 1e-3, P)
    assert end < 0.15 * TYRE.relaxation_y
    assert magic_formula(0.0, end / TYRE.relaxation_y, 3000.0, 1.0, P)[1] > 0.9 * peaks(3000.0)[1]


@given(st.floats(3.0, 40.0), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_a_relaxed_tyre_slips_by_velocity_ratio(speed, kappa, tangent):
    x, y, *slip = relaxed_slip(0.0, 0.0, -kappa * speed, -tangent * speed, speed, 1e6, P)
    assert slip == pytest.approx((kappa, math.atan(tangent)), rel=1e-5, abs=1e-9)
    assert (x, y) == pytest.approx((kappa * TYRE.relaxation_x, tangent * TYRE.relaxation_y), rel=1e-5, abs=1e-9)
