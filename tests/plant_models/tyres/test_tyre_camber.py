"""Camber, shifts and aligning moment of the tyre law, against the book's equations and against symmetry."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.plant_models.tyres.formula import cornering_stiffness, magic_formula, tyre_forces
from sidestep.plant_models.tyres.parameters import TyreParameters

# Of the size that files of passenger-car tyres have, signs of our axes.
FULL = TyreParameters(
    nominal_load=4000.0, radius=0.317, p_dx3=5.0, p_ex2=0.1, p_ex3=-0.05, p_ex4=0.02, p_kx2=0.4, p_kx3=-0.2,
    p_hx1=1e-3, p_hx2=2e-4, p_vx1=-1e-3, p_vx2=3e-4, p_dy3=2.5, p_ey2=-0.6, p_ey3=0.1, p_ey4=-5.0, p_ey5=0.2,
    p_ky3=0.3, p_ky4=1.9, p_ky5=0.1, p_ky6=-0.9, p_ky7=-0.2, p_hy1=3e-3, p_hy2=-1e-3, p_vy1=0.04, p_vy2=-0.02,
    p_vy3=-0.3, p_vy4=-0.2, r_bx3=0.5, r_ex2=-0.3, r_hx1=2e-3, r_by3=-0.02, r_by4=1.0, r_ey2=-0.1, r_hy1=0.01,
    r_hy2=0.005, r_vy1=0.05, r_vy2=-0.07, r_vy3=-0.3, r_vy4=12.0, r_vy5=1.9, r_vy6=-10.0, q_bz1=10.0, q_bz2=-1.5,
    q_bz3=-0.3, q_bz4=-0.2, q_bz5=-0.4, q_bz9=18.0, q_bz10=0.1, q_cz1=1.2, q_dz1=0.09, q_dz2=-0.005, q_dz3=-0.1,
    q_dz4=0.7, q_dz6=0.002, q_dz7=-0.001, q_dz8=-0.2, q_dz9=-0.03, q_ez1=-1.6, q_ez2=-0.4, q_ez3=0.1, q_ez4=-0.2,
    q_ez5=-0.9, q_hz1=0.005, q_hz2=-0.002, q_hz3=0.1, q_hz4=0.1, s_sz1=0.03, s_sz2=0.01, s_sz3=0.5, s_sz4=-0.3,
    p_hy3=0.02,
)  # fmt: skip
PLAIN = replace(FULL.without_shifts(), p_hy3=0.0)

slips = st.floats(-0.5, 0.5)
leans = st.floats(-0.1, 0.1)
loads = st.floats(500.0, 8000.0)


def book(kappa, alpha, gamma, fz, t):
    """Pacejka, 3rd ed., (4.E9) to (4.E78), written out once more for friction 1."""
    atan, cos, sin, sgn = math.atan, math.cos, math.sin, np.sign

    def mf(b, c, e, x):
        return c * atan(b * x - e * (b * x - atan(b * x)))

    f0, g, df = t.nominal_load, sin(gamma), fz / t.nominal_load - 1.0
    kx = kappa + t.p_hx1 + t.p_hx2 * df
    dx = (t.p_dx1 + t.p_dx2 * df) * (1 - t.p_dx3 * g**2) * fz
    ex = (t.p_ex1 + t.p_ex2 * df + t.p_ex3 * df**2) * (1 - t.p_ex4 * sgn(kx))
    k_x = fz * (t.p_kx1 + t.p_kx2 * df) * math.exp(t.p_kx3 * df)
    fx0 = dx * sin(mf(k_x / t.p_cx1 / dx, t.p_cx1, ex, kx)) + fz * (t.p_vx1 + t.p_vx2 * df)
    k_y = t.p_ky1 * f0 * (1 - t.p_ky3 * abs(g)) * sin(t.p_ky4 * atan(fz / f0 / (t.p_ky2 + t.p_ky5 * g**2)))
    sv_g = fz * (t.p_vy3 + t.p_vy4 * df) * g
    sh = t.p_hy1 + t.p_hy2 * df + t.p_hy3 * g + (fz * (t.p_ky6 + t.p_ky7 * df) * g - sv_g) / k_y
    sv = fz * (t.p_vy1 + t.p_vy2 * df) + sv_g
    dy = (t.p_dy1 + t.p_dy2 * df) * (1 - t.p_dy3 * g**2) * fz
    ay = alpha + sh
    ey = (t.p_ey1 + t.p_ey2 * df) * (1 + t.p_ey5 * g**2 - (t.p_ey3 + t.p_ey4 * g) * sgn(ay))
    b_y = k_y / t.p_cy1 / dy
    fy0 = dy * sin(mf(b_y, t.p_cy1, min(ey, 1.0), ay)) + sv
    bxa = (t.r_bx1 + t.r_bx3 * g**2) * cos(atan(t.r_bx2 * kappa))
    exa = t.r_ex1 + t.r_ex2 * df
    fx = fx0 * max(cos(mf(bxa, t.r_cx1, exa, alpha + t.r_hx1)), 0) / cos(mf(bxa, t.r_cx1, exa, t.r_hx1))
    byk = (t.r_by1 + t.r_by4 * g**2) * cos(atan(t.r_by2 * (alpha - t.r_by3)))
    eyk, shk = t.r_ey1 + t.r_ey2 * df, t.r_hy1 + t.r_hy2 * df
    fyp = fy0 * max(cos(mf(byk, t.r_cy1, eyk, kappa + shk)), 0) / cos(mf(byk, t.r_cy1, eyk, shk))
    dvk = dy * (t.r_vy1 + t.r_vy2 * df + t.r_vy3 * g) * cos(atan(t.r_vy4 * alpha))
    at = alpha + t.q_hz1 + t.q_hz2 * df + (t.q_hz3 + t.q_hz4 * df) * g
    ate = math.sqrt(at**2 + (k_x / k_y * kappa) ** 2) * math.copysign(1.0, at)
    bt = (t.q_bz1 + t.q_bz2 * df + t.q_bz3 * df**2) * (1 + t.q_bz4 * g + t.q_bz5 * abs(g))
    et = (t.q_ez1 + t.q_ez2 * df + t.q_ez3 * df**2) * (
        1 + (t.q_ez4 + t.q_ez5 * g) * 2 / math.pi * atan(bt * t.q_cz1 * ate)
    )
    dt = fz * t.radius / f0 * (t.q_dz1 + t.q_dz2 * df) * (1 + t.q_dz3 * g + t.q_dz4 * g**2)
    trail = dt * cos(mf(bt, t.q_cz1, min(et, 1.0), ate)) * cos(alpha)
    are = math.sqrt((alpha + sh + sv / k_y) ** 2 + (k_x / k_y * kappa) ** 2)
    mzr = fz * t.radius * (t.q_dz6 + t.q_dz7 * df + (t.q_dz8 + t.q_dz9 * df) * g) * cos(alpha)
    mzr *= cos(atan((t.q_bz9 + t.q_bz10 * b_y * t.p_cy1) * are))
    s = t.radius * (t.s_sz1 + t.s_sz2 * fyp / f0 + (t.s_sz3 + t.s_sz4 * df) * g)
    return fx, fyp + dvk * sin(t.r_vy5 * atan(t.r_vy6 * kappa)), mzr - trail * fyp + s * fx


@given(slips, slips, leans, st.floats(1500.0, 7000.0))
def test_forces_and_moment_are_the_book_s(kappa, alpha, camber, load):
    got = tyre_forces(kappa, alpha, camber, load, 1.0, FULL.as_array())
    assert got == pytest.approx(book(kappa, alpha, camber, load, FULL), rel=1e-9, abs=1e-7)


@given(slips, slips, leans, loads, st.floats(0.2, 1.2))
def test_the_other_side_s_tyre_is_the_mirror_image(kappa, alpha, camber, load, friction):
    for tyre, other in ((FULL, FULL.mirrored()), (PLAIN, PLAIN)):
        fx, fy, mz = tyre_forces(kappa, alpha, camber, load, friction, tyre.as_array())
        mirrored = tyre_forces(kappa, -alpha, -camber, load, friction, other.as_array())
        assert mirrored == pytest.approx((fx, -fy, -mz), rel=1e-9, abs=1e-7)


def test_without_shifts_nothing_acts_at_zero_slip():
    for load in (1000.0, 4000.0, 7000.0):
        assert np.abs(tyre_forces(0.0, 0.0, 0.0, load, 1.0, FULL.as_array())).max() > 1.0
        assert tyre_forces(0.0, 0.0, 0.0, load, 1.0, PLAIN.as_array()) == (0.0, 0.0, 0.0)


@given(loads)
def test_camber_thrust_is_its_stiffness(load):
    """d F_y / d gamma = F_z (p_ky6 + p_ky7 dfz), whatever the vertical shift takes of it."""
    h, p = 1e-5, replace(PLAIN, p_ey1=0.0, p_ey2=0.0).as_array()
    slope = (tyre_forces(0.0, 0.0, h, load, 1.0, p)[1] - tyre_forces(0.0, 0.0, -h, load, 1.0, p)[1]) / (2 * h)
    assert slope == pytest.approx(load * (FULL.p_ky6 + FULL.p_ky7 * (load / 4000.0 - 1.0)), rel=1e-4)


@given(loads)
def test_the_moment_turns_the_wheel_out_of_its_slip_by_the_trail(load):
    h, p, dfz = 1e-5, PLAIN.as_array(), load / 4000.0 - 1.0
    _, fy, mz = tyre_forces(0.0, h, 0.0, load, 1.0, p)
    assert fy / h == pytest.approx(cornering_stiffness(load, p), rel=1e-4)
    assert -mz / fy == pytest.approx(load / 4000.0 * FULL.radius * (FULL.q_dz1 + FULL.q_dz2 * dfz), rel=1e-4)


@given(slips, slips, leans, loads)
def test_the_defaults_know_neither_camber_nor_moment(kappa, alpha, camber, load):
    p = TyreParameters().as_array()
    forces = (*magic_formula(kappa, alpha, load, 0.8, p), 0.0)
    assert tyre_forces(kappa, alpha, camber, load, 0.8, p) == pytest.approx(forces, rel=1e-12)


@pytest.mark.parametrize("name", [f.name for f in fields(TyreParameters)])
def test_every_coefficient_but_the_relaxation_lengths_acts(name):
    """A coefficient that is read nowhere would be a promise broken."""
    if name.startswith("relaxation"):
        return
    arguments = (0.03, 0.05, 0.06, 2500.0, 0.9)
    changed = replace(FULL, **{name: 1.1 * getattr(FULL, name)})
    assert tyre_forces(*arguments, changed.as_array()) != tyre_forces(*arguments, FULL.as_array())
