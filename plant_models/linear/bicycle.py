"""The paper's linear model (5): kinematic error in road coordinates plus linear-tyre single track.

State x = [l_s, e_phi, beta, gamma]: lateral offset [m], heading error [rad], sideslip [rad], yaw rate
[rad/s]. Two corrections to the printed equations: the curvature enters to first order in l_s (exact:
s' = v cos(e) / (1 - kappa l)), which costs nothing, and (5) is read with w_r = gamma.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from sidestep.plant_models.vehicle.parameters import VehicleParameters

Matrix = NDArray[np.float64]


def continuous(vehicle: VehicleParameters, speed: float, curvature: float = 0.0) -> tuple[Matrix, Matrix, Matrix]:
    """A_m (4, 4), B_m (4,) and C_m (4,) of x' = A x + B delta + C. Eq. (5), (6).

    Args:
        vehicle: Mass, inertia, geometry and axle stiffness (2 k_f, 2 k_r of the paper).
        speed: v, in [m/s], > 0.
        curvature: kappa(s) of the reference path, in [1/m].
    """
    m, i_z, v = vehicle.mass, vehicle.yaw_inertia, speed
    c_f, c_r, l_f, l_r = (
        vehicle.cornering_stiffness_front, vehicle.cornering_stiffness_rear, vehicle.l_f, vehicle.l_r
    )  # fmt: skip
    moment = l_f * c_f - l_r * c_r
    a = np.array(
        [
            [0.0, v, v, 0.0],
            [-v * curvature**2, 0.0, 0.0, 1.0],
            [0.0, 0.0, -(c_f + c_r) / (m * v), -moment / (m * v**2) - 1.0],
            [0.0, 0.0, -moment / i_z, -(l_f**2 * c_f + l_r**2 * c_r) / (i_z * v)],
        ]
    )
    b = np.array([0.0, 0.0, c_f / (m * v), l_f * c_f / i_z])
    c = np.array([0.0, -v * curvature, 0.0, 0.0])
    return a, b, c


def discretise(a: Matrix, inputs: Matrix, dt: float) -> tuple[Matrix, Matrix]:
    """Exact zero-order-hold discretisation of x' = A x + G w.

    Args:
        a: Shape (n, n).
        inputs: G, shape (n, m); every column is one held input.
        dt: Step, in [s].

    Returns:
        A_k (n, n) and G_k (n, m).
    """
    n, m = inputs.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, inputs
    e = np.asarray(expm(block * dt), dtype=np.float64)
    return e[:n, :n], e[:n, n:]


def euler(a: Matrix, inputs: Matrix, dt: float) -> tuple[Matrix, Matrix]:
    """Forward Euler as printed in Eq. (7); unstable where dt exceeds 2 |Re p| / |p|^2 of a pole p."""
    return np.eye(len(a)) + a * dt, inputs * dt
