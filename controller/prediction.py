"""Prediction model of the MPC: Eq. (5) with the steering actuator, discretised exactly.

State x = [l_s, e_phi, beta, gamma, delta, delta_c]: the paper's four plus realised and commanded road-wheel
angle. Inputs: steering rate u = delta_c' (a ramp within each step) and the heading rate of the road.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sidestep.plant_models.vehicle import VehicleParameters

STATES, WIDTH = 6, 8
HORIZON, COARSEST_STEP = 2.58, 0.16
"""Length of the prediction and of its longest step, in [s]."""
SLOWEST = 1.0
"""Speed below which the model keeps the dynamics of this speed, in [m/s]: Eq. (5) divides by v."""


def model_parameters(vehicle: VehicleParameters) -> NDArray[np.float64]:
    """Mass, yaw_inertia, l_f, l_r, axle stiffness front and rear, steering time constant; shape (7,)."""
    return np.array([
        vehicle.mass, vehicle.yaw_inertia, vehicle.l_f, vehicle.l_r, vehicle.cornering_stiffness_front,
        vehicle.cornering_stiffness_rear, vehicle.steer_time_constant,
    ])  # fmt: skip


@njit(cache=True, nogil=True)
def model_block(speed, car):
    """Generator of the augmented system [x; u; road turn rate], inputs held.

    Args:
        speed: v, in [m/s].
        car: `model_parameters`, shape (7,).

    Returns:
        Shape (8, 8); its exponential over dt holds A_k, B_k and the effect of curvature.
    """
    v = max(speed, SLOWEST)
    m, i_z, l_f, l_r, c_f, c_r, lag = car
    moment = l_f * c_f - l_r * c_r
    a = np.zeros((WIDTH, WIDTH))
    a[0, 1] = a[0, 2] = v
    a[1, 3], a[1, 7] = 1.0, -1.0
    a[2, 2], a[2, 3], a[2, 4] = -(c_f + c_r) / (m * v), -moment / (m * v * v) - 1.0, c_f / (m * v)
    a[3, 2], a[3, 3], a[3, 4] = (
        -moment / i_z, -(l_f * l_f * c_f + l_r * l_r * c_r) / (i_z * v), l_f * c_f / i_z
    )  # fmt: skip
    if lag > 1e-3:
        a[4, 4], a[4, 5] = -1.0 / lag, 1.0 / lag
    else:
        a[4, 6] = 1.0
    a[5, 6] = 1.0
    return a


@njit(cache=True, nogil=True)
def _multiply(a, b, out):
    for i in range(WIDTH):
        for j in range(WIDTH):
            out[i, j] = 0.0
        for k in range(WIDTH):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(WIDTH):
                    out[i, j] += factor * b[k, j]


@njit(cache=True, nogil=True)
def exponential(a, dt):
    """Matrix exponential of a dt by scaling, an eighth-order Taylor polynomial and squaring.

    The scaled norm stays below 1/4, which leaves a truncation error below 1e-11.
    """
    norm = np.abs(a).sum(axis=1).max() * dt
    squarings = 0
    while norm > 0.25:
        norm *= 0.5
        squarings += 1
    x = a * (dt / 2.0**squarings)
    identity = np.eye(WIDTH)
    e, product = identity + x / 8.0, np.empty((WIDTH, WIDTH))
    for k in range(7, 0, -1):
        _multiply(x, e, product)
        e = identity + product / k
    for _ in range(squarings):
        _multiply(e, e, product)
        e, product = product, e
    return e


@njit(cache=True, nogil=True)
def stage_matrices(speed, car, shortest, levels):
    """Exact discretisation over dt, 2 dt, 4 dt, ... by squaring, shape (levels, 8, 8)."""
    stages = np.empty((levels, WIDTH, WIDTH))
    stages[0] = exponential(model_block(speed, car), shortest)
    for i in range(1, levels):
        _multiply(stages[i - 1], stages[i - 1], stages[i])
    return stages


@njit(cache=True, nogil=True)
def advance(state, speed, car, period, commands, turn_rate):
    """Move a state forward through commands that are already on their way.

    Args:
        state: Shape (6,).
        speed, turn_rate: Of the car, in [m/s], and of the road, in [rad/s]; held.
        car: See `model_block`.
        period: How long each command is held, in [s].
        commands: Angles in the order in which they take effect, shape (d,), in [rad].

    Returns:
        The state after d periods, shape (6,).
    """
    x = state.copy()
    if commands.shape[0] == 0:
        return x
    e = exponential(model_block(speed, car), period)
    carry, road = e[:STATES, :STATES].copy(), e[:STATES, 7] * turn_rate
    for command in commands:
        x[5] = command
        if car[6] <= 1e-3:
            x[4] = command
        x = carry @ x + road
    return x


@njit(cache=True, nogil=True)
def steady_gain(speed, car):
    """Steady lateral acceleration per road-wheel angle, v^2 / (L + K v^2), in [m/s^2/rad]."""
    m, _, l_f, l_r, c_f, c_r, _ = car
    wheelbase = l_f + l_r
    understeer = m / wheelbase * (l_r / c_f - l_f / c_r)
    return speed * speed / max(wheelbase + understeer * speed * speed, 0.2 * wheelbase)


def grid(period: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Prediction grid: fine where the car is, coarse ahead, every step the first times a power of two.

    Args:
        period: Control period, in [s].

    Returns:
        level (N,) such that step k lasts period 2^level[k], and the control move (N,) that acts in it.
    """
    coarsest = max(round(math.log2(COARSEST_STEP / period)), 0)
    level = [0] * 3
    for i in range(1, coarsest):
        level += [i] * (3 if i == 1 else 4)
    rest = HORIZON - period * sum(2**i for i in level)
    level += [coarsest] * max(round(rest / (period * 2**coarsest)), 1)
    lengths = [1] * 6 + [2] * 4
    lengths += [3] * math.ceil(max(len(level) - sum(lengths), 0) / 3)
    block = np.repeat(np.arange(len(lengths)), lengths)[: len(level)]
    return np.array(level), block
