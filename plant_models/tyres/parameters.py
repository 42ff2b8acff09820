"""The coefficients of the tyre law in `tyre`, checked, as Python and as kernels take them."""

import math
from dataclasses import astuple, dataclass, fields, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.ranges import Range, check
from sidestep.plant_models.tyres.formula import cornering_stiffness

_PUBLISHED_KY1 = 21.92
_KY2 = 1.6


Coefficient = Annotated[float, Range(-1e5, 1e5)]  # published: RVY1 = -1410
Positive = Annotated[float, Range(0.01, 1e3)]
Length = Annotated[float, Range(0.001, 10.0, "m")]


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
        p_hy3: Shift by camber, as MF-Tyre 5.2 has it; 6.1 lets it follow from p_ky6 and p_vy3.
        p_h.., p_v..: Horizontal and vertical shifts of pure slip.
        r_..: Weights of combined slip; r_vy..: lateral force induced by longitudinal slip.
        q_.., s_sz..: Aligning moment; none at all with q_cz1 = 0.
        relaxation_x, relaxation_y: Relaxation lengths, in [m].
        radius: Unloaded radius R_0 that the aligning moment is related to, in [m].
    """

    nominal_load: Annotated[float, Range(1.0, 1e6, "N")] = 4000.0
    p_cx1: Positive = 1.6411
    p_dx1: Positive = 1.1739
    p_dx2: Coefficient = -0.08
    p_ex1: Coefficient = 0.46403
    p_kx1: Positive = 22.303
    p_cy1: Positive = 1.3507
    p_dy1: Positive = 1.0489
    p_dy2: Coefficient = -0.10
    p_ey1: Coefficient = -0.0074722
    p_ky1: Positive = _PUBLISHED_KY1 / math.sin(2.0 * math.atan(1.0 / _KY2))
    p_ky2: Coefficient = _KY2
    r_bx1: Coefficient = 13.276
    r_bx2: Coefficient = -13.778
    r_cx1: Coefficient = 1.2568
    r_ex1: Coefficient = 0.65225
    r_by1: Coefficient = 7.1433
    r_by2: Coefficient = 9.1916
    r_cy1: Coefficient = 1.0719
    r_ey1: Coefficient = -0.27572
    relaxation_x: Length = 0.15
    relaxation_y: Length = 0.30
    radius: Length = 0.33
    p_dx3: Coefficient = 0.0
    p_ex2: Coefficient = 0.0
    p_ex3: Coefficient = 0.0
    p_ex4: Coefficient = 0.0
    p_kx2: Coefficient = 0.0
    p_kx3: Coefficient = 0.0
    p_hx1: Coefficient = 0.0
    p_hx2: Coefficient = 0.0
    p_vx1: Coefficient = 0.0
    p_vx2: Coefficient = 0.0
    p_dy3: Coefficient = 0.0
    p_ey2: Coefficient = 0.0
    p_ey3: Coefficient = 0.0
    p_ey4: Coefficient = 0.0
    p_ey5: Coefficient = 0.0
    p_ky3: Coefficient = 0.0
    p_ky4: Positive = 2.0
    p_ky5: Coefficient = 0.0
    p_ky6: Coefficient = 0.0
    p_ky7: Coefficient = 0.0
    p_hy1: Coefficient = 0.0
    p_hy2: Coefficient = 0.0
    p_vy1: Coefficient = 0.0
    p_vy2: Coefficient = 0.0
    p_vy3: Coefficient = 0.0
    p_vy4: Coefficient = 0.0
    r_bx3: Coefficient = 0.0
    r_ex2: Coefficient = 0.0
    r_hx1: Coefficient = 0.0
    r_by3: Coefficient = 0.0
    r_by4: Coefficient = 0.0
    r_ey2: Coefficient = 0.0
    r_hy1: Coefficient = 0.0
    r_hy2: Coefficient = 0.0
    r_vy1: Coefficient = 0.0
    r_vy2: Coefficient = 0.0
    r_vy3: Coefficient = 0.0
    r_vy4: Coefficient = 0.0
    r_vy5: Coefficient = 0.0
    r_vy6: Coefficient = 0.0
    q_bz1: Coefficient = 0.0
    q_bz2: Coefficient = 0.0
    q_bz3: Coefficient = 0.0
    q_bz4: Coefficient = 0.0
    q_bz5: Coefficient = 0.0
    q_bz9: Coefficient = 0.0
    q_bz10: Coefficient = 0.0
    q_cz1: Coefficient = 0.0
    q_dz1: Coefficient = 0.0
    q_dz2: Coefficient = 0.0
    q_dz3: Coefficient = 0.0
    q_dz4: Coefficient = 0.0
    q_dz6: Coefficient = 0.0
    q_dz7: Coefficient = 0.0
    q_dz8: Coefficient = 0.0
    q_dz9: Coefficient = 0.0
    q_ez1: Coefficient = 0.0
    q_ez2: Coefficient = 0.0
    q_ez3: Coefficient = 0.0
    q_ez4: Coefficient = 0.0
    q_ez5: Coefficient = 0.0
    q_hz1: Coefficient = 0.0
    q_hz2: Coefficient = 0.0
    q_hz3: Coefficient = 0.0
    q_hz4: Coefficient = 0.0
    s_sz1: Coefficient = 0.0
    s_sz2: Coefficient = 0.0
    s_sz3: Coefficient = 0.0
    s_sz4: Coefficient = 0.0
    p_hy3: Coefficient = 0.0

    def __post_init__(self) -> None:
        check(self, "vehicle.tyre")

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

_ONE_SIDED = (
    "p_hy1", "p_hy2", "p_vy1", "p_vy2", "p_ey3", "r_hx1", "r_by3", "r_vy1", "r_vy2", "q_bz4", "q_dz3", "q_dz6", "q_dz7",
    "q_ez4", "q_hz1", "q_hz2", "s_sz1",
)  # fmt: skip
_SHIFTS = (*_ONE_SIDED, "p_hx1", "p_hx2", "p_vx1", "p_vx2", "r_hy1", "r_hy2")
