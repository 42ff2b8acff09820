"""Tyre law: Magic Formula 6.1, pure and combined slip, load, camber, aligning moment, road friction.

After Pacejka, Tire and Vehicle Dynamics, 3rd ed., section 4.3.2, with the camber terms of the moment as in
the TNO files, without turn slip and inflation pressure. Forces act on the car, axes after ISO 8855 in the
wheel's plane on the road. A positive slip angle gives a positive lateral force, so that the slope at the
origin is the cornering stiffness.
"""

import math
from dataclasses import astuple, dataclass, fields, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError

_PUBLISHED_KY1 = 21.92
_KY2 = 1.6


@dataclass(frozen=True)
class TyreParameters:
    """Magic Formula coefficients of one tyre, dimensionless unless said otherwise.

    Defaults are the subset published with the CommonRoad vehicle models (from ADAMS), p_ky1 converted
    so that the stiffness at the nominal load is the published one, plus our typical passenger-car
    values for what that set lacks: load sensitivity (p_dx2, p_dy2, p_ky2) and relaxation. All else is 0:
    no camber thrust, no shifts, no aligning moment. A tyre with shifts is one of the left side; on the
    right side the car mounts its mirror image.

    Attributes:
        nominal_load: F_z0, in [N].
        p_c.. p_d.. p_e.. p_k..: Shape, peak, curvature and stiffness of pure slip, x along and y across;
            p_ky1 positive.
        p_ky2: Load, in units of nominal_load, at which the cornering stiffness peaks; 0 means
            a stiffness proportional to load, p_ky1 F_z, as in the published subset.
        p_ky6, p_ky7: Camber stiffness, over load.
        p_h.., p_v..: Horizontal and vertical shifts of pure slip.
        r_..: Weights of combined slip; r_vy..: lateral force induced by longitudinal slip.
        q_.., s_sz..: Aligning moment; none at all with q_cz1 = 0.
        relaxation_x, relaxation_y: Relaxation lengths, in [m].
        radius: Unloaded radius R_0 that the aligning moment is related to, in [m].
    """

    nominal_load: float = 4000.0
    p_cx1: float = 1.6411
    p_dx1: float = 1.1739
    p_dx2: float = -0.08
    p_ex1: float = 0.46403
    p_kx1: float = 22.303
    p_cy1: float = 1.3507
    p_dy1: float = 1.0489
    p_dy2: float = -0.10
    p_ey1: float = -0.0074722
    p_ky1: float = _PUBLISHED_KY1 / math.sin(2.0 * math.atan(1.0 / _KY2))
    p_ky2: float = _KY2
    r_bx1: float = 13.276
    r_bx2: float = -13.778
    r_cx1: float = 1.2568
    r_ex1: float = 0.65225
    r_by1: float = 7.1433
    r_by2: float = 9.1916
    r_cy1: float = 1.0719
    r_ey1: float = -0.27572
    relaxation_x: float = 0.15
    relaxation_y: float = 0.30
    radius: float = 0.33
    p_dx3: float = 0.0
    p_ex2: float = 0.0
    p_ex3: float = 0.0
    p_ex4: float = 0.0
    p_kx2: float = 0.0
    p_kx3: float = 0.0
    p_hx1: float = 0.0
    p_hx2: float = 0.0
    p_vx1: float = 0.0
    p_vx2: float = 0.0
    p_dy3: float = 0.0
    p_ey2: float = 0.0
    p_ey3: float = 0.0
    p_ey4: float = 0.0
    p_ey5: float = 0.0
    p_ky3: float = 0.0
    p_ky4: float = 2.0
    p_ky5: float = 0.0
    p_ky6: float = 0.0
    p_ky7: float = 0.0
    p_hy1: float = 0.0
    p_hy2: float = 0.0
    p_vy1: float = 0.0
    p_vy2: float = 0.0
    p_vy3: float = 0.0
    p_vy4: float = 0.0
    r_bx3: float = 0.0
    r_ex2: float = 0.0
    r_hx1: float = 0.0
    r_by3: float = 0.0
    r_by4: float = 0.0
    r_ey2: float = 0.0
    r_hy1: float = 0.0
    r_hy2: float = 0.0
    r_vy1: float = 0.0
    r_vy2: float = 0.0
    r_vy3: float = 0.0
    r_vy4: float = 0.0
    r_vy5: float = 0.0
    r_vy6: float = 0.0
    q_bz1: float = 0.0
    q_bz2: float = 0.0
    q_bz3: float = 0.0
    q_bz4: float = 0.0
    q_bz5: float = 0.0
    q_bz9: float = 0.0
    q_bz10: float = 0.0
    q_cz1: float = 0.0
    q_dz1: float = 0.0
    q_dz2: float = 0.0
    q_dz3: float = 0.0
    q_dz4: float = 0.0
    q_dz6: float = 0.0
    q_dz7: float = 0.0
    q_dz8: float = 0.0
    q_dz9: float = 0.0
    q_ez1: float = 0.0
    q_ez2: float = 0.0
    q_ez3: float = 0.0
    q_ez4: float = 0.0
    q_ez5: float = 0.0
    q_hz1: float = 0.0
    q_hz2: float = 0.0
    q_hz3: float = 0.0
    q_hz4: float = 0.0
    s_sz1: float = 0.0
    s_sz2: float = 0.0
    s_sz3: float = 0.0
    s_sz4: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise InputError(f"vehicle.tyre.{f.name}", f"{value!r} is not a finite number")
            if f.name in _POSITIVE and value <= 0.0:
                raise InputError(f"vehicle.tyre.{f.name}", f"{value}", "> 0")

    def without_load_sensitivity(self) -> "TyreParameters":
        """Friction constant, cornering stiffness proportional to load; of the defaults: the published subset."""
        stiffness = cornering_stiffness(self.nominal_load, self.as_array()) / self.nominal_load
        return replace(self, p_dx2=0.0, p_dy2=0.0, p_ky1=stiffness, p_ky2=0.0)

    def without_shifts(self) -> "TyreParameters":
        """No force and no moment at zero slip and camber, no left and right: without conicity and ply steer."""
        return replace(self, **dict.fromkeys(_SHIFTS, 0.0))

    def mirrored(self) -> "TyreParameters":
        """The same tyre on the other side of the car."""
        return replace(self, **{name: -getattr(self, name) for name in _ONE_SIDED})

    def as_array(self) -> NDArray[np.void]:
        """The coefficients as the kernels take them: one record of `TYRE`, shape (1,)."""
        return np.array([astuple(self)], dtype=TYRE)


TYRE = np.dtype([(f.name, np.float64) for f in fields(TyreParameters)])
"""The coefficients by name."""

_POSITIVE = (
    "nominal_load", "p_cx1", "p_dx1", "p_kx1", "p_cy1", "p_dy1", "p_ky1", "p_ky4", "relaxation_x", "relaxation_y",
    "radius",
)  # fmt: skip
_ONE_SIDED = (
    "p_hy1", "p_hy2", "p_vy1", "p_vy2", "p_ey3", "r_hx1", "r_by3", "r_vy1", "r_vy2", "q_bz4", "q_dz3", "q_dz6", "q_dz7",
    "q_ez4", "q_hz1", "q_hz2", "s_sz1",
)  # fmt: skip
_SHIFTS = (*_ONE_SIDED, "p_hx1", "p_hx2", "p_vx1", "p_vx2", "r_hy1", "r_hy2")


@njit(cache=True, nogil=True)
def cornering_stiffness(load, p):
    """Slope K_y of the pure lateral force at zero slip and camber, in [N/rad]; `load` in [N], `p` from `as_array`."""
    return _stiffness(load, 0.0, p[0])


@njit(cache=True, nogil=True)
def magic_formula(kappa, alpha, load, friction, p):
    """Longitudinal and lateral force of an upright tyre, in [N]; arguments as of `tyre_forces`."""
    fx, fy, _ = tyre_forces(kappa, alpha, 0.0, load, friction, p)
    return fx, fy


@njit(cache=True, nogil=True)
def tyre_forces(kappa, alpha, camber, load, friction, p):
    """Steady-state shear force and aligning moment of one tyre.

    Road friction shrinks the law to a similar one, F = mu F(kappa / mu, alpha / mu) (Pacejka, section 4.2.1):
    peaks and ellipse scale with it, the slopes at zero slip stay.

    Args:
        kappa: Longitudinal slip ratio, positive when driving, in [-].
        alpha: Slip angle, in [rad].
        camber: Positive with the top to the right, in [rad].
        load: Wheel load, in [N]; no force at or below zero.
        friction: Road friction as a factor on the tyre's peak, in [-].
        p: Coefficients, `TyreParameters.as_array()`.

    Returns:
        Longitudinal and lateral force, in [N], and the moment about the upward axis, in [N m].
    """
    if load <= 0.0 or friction <= 0.0:
        return 0.0, 0.0, 0.0
    t, lean = p[0], math.sin(camber)
    kappa, slip = kappa / friction, alpha / friction
    dfz = load / t["nominal_load"] - 1.0
    fx0, stiffness_x = _pure_longitudinal(kappa, lean, load, dfz, t)
    fy0, stiffness_y, peak_y, shift = _pure_lateral(slip, lean, load, dfz, t)

    b = (t["r_bx1"] + t["r_bx3"] * lean**2) * _cos_atan(t["r_bx2"] * kappa)
    fx = fx0 * _weight(b, t["r_cx1"], t["r_ex1"] + t["r_ex2"] * dfz, slip, t["r_hx1"])
    b = (t["r_by1"] + t["r_by4"] * lean**2) * _cos_atan(t["r_by2"] * (slip - t["r_by3"]))
    fy = fy0 * _weight(b, t["r_cy1"], t["r_ey1"] + t["r_ey2"] * dfz, kappa, t["r_hy1"] + t["r_hy2"] * dfz)
    induced = peak_y * (t["r_vy1"] + t["r_vy2"] * dfz + t["r_vy3"] * lean)
    if induced != 0.0:
        induced *= _cos_atan(t["r_vy4"] * slip) * math.sin(t["r_vy5"] * math.atan(t["r_vy6"] * kappa))

    moment = 0.0
    if t["q_cz1"] > 0.0:
        traction = stiffness_x / stiffness_y * kappa
        trail, residual = _trail(slip, traction, shift, stiffness_y / peak_y, lean, load, dfz, t)
        lever = t["s_sz1"] + t["s_sz2"] * fy / t["nominal_load"] + (t["s_sz3"] + t["s_sz4"] * dfz) * lean
        moment = (residual - trail * fy) * math.cos(alpha) + t["radius"] * lever * fx
    return friction * fx, friction * (fy + induced), friction * moment


@njit(cache=True, nogil=True)
def _cos_atan(x):
    return 1.0 / math.sqrt(1.0 + x * x)


@njit(cache=True, nogil=True)
def _sine(stiffness, peak, shape, curvature, slip):
    x = stiffness / (shape * peak) * slip
    return peak * math.sin(shape * math.atan(x - min(curvature, 1.0) * (x - math.atan(x))))


@njit(cache=True, nogil=True)
def _cosine(b, c, e, slip):
    x = b * slip
    return math.cos(c * math.atan(x - e * (x - math.atan(x))))


@njit(cache=True, nogil=True)
def _weight(b, c, e, slip, shift):
    """Never negative: with c > 1, as published, far slip would turn the other direction's force round."""
    weight = max(_cosine(b, c, e, slip + shift), 0.0)
    return weight if shift == 0.0 else weight / _cosine(b, c, e, shift)


@njit(cache=True, nogil=True)
def _stiffness(load, lean, t):
    if t["p_ky2"] <= 0.0:
        return t["p_ky1"] * load
    knee = (t["p_ky2"] + t["p_ky5"] * lean**2) * t["nominal_load"]
    slope = math.sin(t["p_ky4"] * math.atan(load / knee))
    return t["p_ky1"] * t["nominal_load"] * (1.0 - t["p_ky3"] * abs(lean)) * slope


@njit(cache=True, nogil=True)
def _pure_longitudinal(kappa, lean, load, dfz, t):
    """Force and slip stiffness; (4.E9) to (4.E18)."""
    slip = kappa + t["p_hx1"] + t["p_hx2"] * dfz
    peak = max(t["p_dx1"] + t["p_dx2"] * dfz, 0.1) * max(1.0 - t["p_dx3"] * lean**2, 0.1) * load
    curvature = t["p_ex1"] + t["p_ex2"] * dfz + t["p_ex3"] * dfz**2
    curvature *= 1.0 - t["p_ex4"] * np.sign(slip)
    stiffness = load * (t["p_kx1"] + t["p_kx2"] * dfz) * math.exp(t["p_kx3"] * dfz)
    force = _sine(stiffness, peak, t["p_cx1"], curvature, slip)
    return force + load * (t["p_vx1"] + t["p_vx2"] * dfz), stiffness


@njit(cache=True, nogil=True)
def _pure_lateral(alpha, lean, load, dfz, t):
    """Force, cornering stiffness, peak, and the slip angle by which the curve is shifted; (4.E19) to (4.E30)."""
    peak = max(t["p_dy1"] + t["p_dy2"] * dfz, 0.1) * max(1.0 - t["p_dy3"] * lean**2, 0.1) * load
    stiffness = _stiffness(load, lean, t)
    rise = load * (t["p_vy3"] + t["p_vy4"] * dfz) * lean
    thrust = load * (t["p_ky6"] + t["p_ky7"] * dfz) * lean
    shift = t["p_hy1"] + t["p_hy2"] * dfz + (thrust - rise) / stiffness
    lift = load * (t["p_vy1"] + t["p_vy2"] * dfz) + rise
    slip = alpha + shift
    curvature = t["p_ey1"] + t["p_ey2"] * dfz
    curvature *= 1.0 + t["p_ey5"] * lean**2 - (t["p_ey3"] + t["p_ey4"] * lean) * np.sign(slip)
    return _sine(stiffness, peak, t["p_cy1"], curvature, slip) + lift, stiffness, peak, shift + lift / stiffness


@njit(cache=True, nogil=True)
def _trail(alpha, traction, shift, steepness, lean, load, dfz, t):
    """Pneumatic trail [m] and residual moment [N m] over the cosine of the slip angle; (4.E33) to (4.E49), (4.E71)."""
    moved = alpha + t["q_hz1"] + t["q_hz2"] * dfz + (t["q_hz3"] + t["q_hz4"] * dfz) * lean
    slip = math.copysign(math.hypot(moved, traction), moved)
    b = (t["q_bz1"] + t["q_bz2"] * dfz + t["q_bz3"] * dfz**2) * (1.0 + t["q_bz4"] * lean + t["q_bz5"] * abs(lean))
    e = t["q_ez1"] + t["q_ez2"] * dfz + t["q_ez3"] * dfz**2
    e *= 1.0 + (t["q_ez4"] + t["q_ez5"] * lean) * 2.0 / math.pi * math.atan(b * t["q_cz1"] * slip)
    scale = load * t["radius"]
    d = scale / t["nominal_load"] * (t["q_dz1"] + t["q_dz2"] * dfz) * (1.0 + t["q_dz3"] * lean + t["q_dz4"] * lean**2)
    turned = math.hypot(alpha + shift, traction)
    residual = t["q_dz6"] + t["q_dz7"] * dfz + (t["q_dz8"] + t["q_dz9"] * dfz) * lean
    residual *= scale * _cos_atan((t["q_bz9"] + t["q_bz10"] * steepness) * turned)
    return d * _cosine(b, t["q_cz1"], min(e, 1.0), slip), residual
