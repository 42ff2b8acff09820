"""Tyre law: Magic Formula, pure and combined slip with load sensitivity.

After Pacejka, Tire and Vehicle Dynamics, 3rd ed., section 4.3 (MF 6.1 names), without shifts, camber
and turn slip. Forces act on the car; a positive slip angle gives a positive lateral force, so that
the slope at the origin is the cornering stiffness.
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
    values for what that set lacks: load sensitivity (p_dx2, p_dy2, p_ky2) and relaxation.

    Attributes:
        nominal_load: F_z0, in [N].
        p_cx1, p_dx1, p_dx2, p_ex1, p_kx1: Pure longitudinal slip.
        p_cy1, p_dy1, p_dy2, p_ey1, p_ky1: Pure lateral slip; p_ky1 positive.
        p_ky2: Load, in units of nominal_load, at which the cornering stiffness peaks; 0 means
            a stiffness proportional to load, p_ky1 F_z, as in the published subset.
        r_bx1, r_bx2, r_cx1, r_ex1: Longitudinal force in combined slip.
        r_by1, r_by2, r_cy1, r_ey1: Lateral force in combined slip.
        relaxation_x, relaxation_y: Relaxation lengths, in [m].
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

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise InputError(f"vehicle.tyre.{f.name}", f"{value!r} is not a finite number")
            if f.name in _POSITIVE and value <= 0.0:
                raise InputError(f"vehicle.tyre.{f.name}", f"{value}", "> 0")

    def without_load_sensitivity(self) -> "TyreParameters":
        """The published subset: friction constant, cornering stiffness proportional to load."""
        stiffness = cornering_stiffness(self.nominal_load, self.as_array()) / self.nominal_load
        return replace(self, p_dx2=0.0, p_dy2=0.0, p_ky1=stiffness, p_ky2=0.0)

    def as_array(self) -> NDArray[np.float64]:
        """The coefficients in field order, shape (22,), as the kernels take them."""
        return np.array(astuple(self), dtype=np.float64)


_POSITIVE = ("nominal_load", "p_cx1", "p_dx1", "p_kx1", "p_cy1", "p_dy1", "p_ky1", "relaxation_x", "relaxation_y")


@njit(cache=True, nogil=True)
def cornering_stiffness(load, p):
    """Slope K_y of the pure lateral force at zero slip, in [N/rad]; `load` in [N], `p` from `as_array`."""
    if p[11] <= 0.0:
        return p[10] * load
    return p[10] * p[0] * math.sin(2.0 * math.atan(load / (p[11] * p[0])))


@njit(cache=True, nogil=True)
def _sine(stiffness, peak, shape, curvature, slip):
    x = stiffness / (shape * peak) * slip
    return peak * math.sin(shape * math.atan(x - curvature * (x - math.atan(x))))


@njit(cache=True, nogil=True)
def _weight(b, c, e, slip):
    x = b * slip
    return math.cos(c * math.atan(x - e * (x - math.atan(x))))


@njit(cache=True, nogil=True)
def magic_formula(kappa, alpha, load, friction, p):
    """Steady-state shear force of one tyre.

    Args:
        kappa: Longitudinal slip ratio, positive when driving, in [-].
        alpha: Slip angle, in [rad].
        load: Wheel load, in [N]; no force at or below zero.
        friction: Road friction as a factor on the tyre's peak, in [-].
        p: Coefficients, `TyreParameters.as_array()`.

    Returns:
        Longitudinal and lateral force, in [N].
    """
    if load <= 0.0 or friction <= 0.0:
        return 0.0, 0.0
    dfz = load / p[0] - 1.0
    peak_x = max(p[2] + p[3] * dfz, 0.1) * load * friction
    peak_y = max(p[7] + p[8] * dfz, 0.1) * load * friction
    fx = _sine(p[5] * load, peak_x, p[1], p[4], kappa)
    fy = _sine(cornering_stiffness(load, p), peak_y, p[6], p[9], alpha)
    fx *= _weight(p[12] * math.cos(math.atan(p[13] * kappa)), p[14], p[15], alpha)
    fy *= _weight(p[16] * math.cos(math.atan(p[17] * alpha)), p[18], p[19], kappa)
    return fx, fy
