"""Tyre law: Magic Formula 6.1, pure and combined slip, load, camber, aligning moment, road friction.

After Pacejka, Tire and Vehicle Dynamics, 3rd ed., section 4.3.2, with the camber terms of the moment as in
the TNO files and the camber shift of MF-Tyre 5.2, without turn slip. Forces act on the car, axes after ISO 8855 in the
wheel's plane on the road. A positive slip angle gives a positive lateral force, so that the slope at the
origin is the cornering stiffness.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.kernels import Record, kernel


@kernel
def cornering_stiffness(load: float, p: NDArray[np.void]) -> float:
    """Slope K_y of the pure lateral force at zero slip and camber, in [N/rad]; `load` in [N], `p` from `as_array`."""
    return _stiffness(load, 0.0, p[0])


@kernel
def magic_formula(kappa: float, alpha: float, load: float, friction: float, p: NDArray[np.void]) -> tuple[float, float]:
    """Longitudinal and lateral force of an upright tyre, in [N]; arguments as of `tyre_forces`."""
    fx, fy, _ = tyre_forces(kappa, alpha, 0.0, load, friction, p)
    return fx, fy


@kernel
def lateral_force(alpha: Any, load: float, friction: float, p: Record, scale: Any = 1.0) -> Any:
    """Lateral force of an upright tyre without longitudinal slip, in [N]; arguments as of `tyre_forces`."""
    if load <= 0.0 or friction <= 0.0:
        return 0.0
    force, _, _, _ = _pure_lateral(alpha / friction, 0.0, load, load / p[0]["nominal_load"] - 1.0, p[0], scale)
    return friction * force


@kernel
def tyre_forces(kappa: Any, alpha: Any, camber: Any, load: float, friction: float, p: Record, scale: Any = 1.0) -> Any:
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
        scale: Factor on the cornering stiffness, LKY of the TNO files.

    Returns:
        Longitudinal and lateral force, in [N], and the moment about the upward axis, in [N m].
    """
    if load <= 0.0 or friction <= 0.0:
        return 0.0, 0.0, 0.0
    t, lean = p[0], math.sin(camber)
    kappa, slip = kappa / friction, alpha / friction
    dfz = load / t["nominal_load"] - 1.0
    fx0, stiffness_x = _pure_longitudinal(kappa, lean, load, dfz, t)
    fy0, stiffness_y, peak_y, shift = _pure_lateral(slip, lean, load, dfz, t, scale)

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


@kernel
def _cos_atan(x):
    return 1.0 / math.sqrt(1.0 + x * x)


@kernel
def _sine(stiffness, peak, shape, curvature, slip):
    x = stiffness / (shape * peak) * slip
    return peak * math.sin(shape * math.atan(x - min(curvature, 1.0) * (x - math.atan(x))))


@kernel
def _cosine(b, c, e, slip):
    x = b * slip
    return math.cos(c * math.atan(x - e * (x - math.atan(x))))


@kernel
def _weight(b, c, e, slip, shift):
    """Never negative: with c > 1, as published, far slip would turn the other direction's force round."""
    weight = max(_cosine(b, c, e, slip + shift), 0.0)
    return weight if shift == 0.0 else weight / _cosine(b, c, e, shift)


@kernel
def _stiffness(load, lean, t):
    if t["p_ky2"] <= 0.0:
        return t["p_ky1"] * load
    knee = (t["p_ky2"] + t["p_ky5"] * lean**2) * t["nominal_load"]
    slope = math.sin(t["p_ky4"] * math.atan(load / knee))
    return t["p_ky1"] * t["nominal_load"] * (1.0 - t["p_ky3"] * abs(lean)) * slope


@kernel
def _pure_longitudinal(kappa, lean, load, dfz, t):
    """Force and slip stiffness; (4.E9) to (4.E18)."""
    slip = kappa + t["p_hx1"] + t["p_hx2"] * dfz
    peak = max(t["p_dx1"] + t["p_dx2"] * dfz, 0.1) * max(1.0 - t["p_dx3"] * lean**2, 0.1) * load
    curvature = t["p_ex1"] + t["p_ex2"] * dfz + t["p_ex3"] * dfz**2
    curvature *= 1.0 - t["p_ex4"] * np.sign(slip)
    stiffness = load * (t["p_kx1"] + t["p_kx2"] * dfz) * math.exp(t["p_kx3"] * dfz)
    force = _sine(stiffness, peak, t["p_cx1"], curvature, slip)
    return force + load * (t["p_vx1"] + t["p_vx2"] * dfz), stiffness


@kernel
def _pure_lateral(alpha, lean, load, dfz, t, scale):
    """Force, cornering stiffness, peak, and the slip angle by which the curve is shifted; (4.E19) to (4.E30)."""
    peak = max(t["p_dy1"] + t["p_dy2"] * dfz, 0.1) * max(1.0 - t["p_dy3"] * lean**2, 0.1) * load
    stiffness = scale * _stiffness(load, lean, t)
    rise = load * (t["p_vy3"] + t["p_vy4"] * dfz) * lean
    thrust = load * (t["p_ky6"] + t["p_ky7"] * dfz) * lean
    shift = t["p_hy1"] + t["p_hy2"] * dfz + t["p_hy3"] * lean + (thrust - rise) / stiffness
    lift = load * (t["p_vy1"] + t["p_vy2"] * dfz) + rise
    slip = alpha + shift
    curvature = t["p_ey1"] + t["p_ey2"] * dfz
    curvature *= 1.0 + t["p_ey5"] * lean**2 - (t["p_ey3"] + t["p_ey4"] * lean) * np.sign(slip)
    return _sine(stiffness, peak, t["p_cy1"], curvature, slip) + lift, stiffness, peak, shift + lift / stiffness


@kernel
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
