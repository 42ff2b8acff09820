"""The single track that is fitted to logs: axle forces with peak, load transfer and relaxation, many windows at once.

    m (v_y' + v_x r) = F_f cos(delta) + F_r - m b          b: acceleration by which a banked road pulls to the right
    (I_z + J b^2 / R^2) r' = l_f F_f cos(delta) - l_r F_r - m a_x y_g - J / R v_x phi'
    sigma F_i' = v_x (D_i sin(C atan(x - E (x - atan x))) - F_i),   x = K_i alpha_i / (C D_i)
    K_i = C_i (1 + n (N_i / N_i0 - 1)),   D_i = mu_i N_i sqrt(1 - u_i^2),   N_i = N_i0 -+ m a_x h / L

    phi'' = w^2 (k a - phi) - 2 z w phi',   a = (F_f cos(delta) + F_r) / m

C_i is the axle's stiffness under its static load N_i0, u_i the share of its friction that braking (by load) or driving
takes, y_g how far the centre of gravity is left of the car's middle, J the spin inertia of all wheels, R their radius
and b half the track: a wheel turns faster on the outside of a turn, and is a gyroscope that rolls. The body rolls by
phi about an axis on the ground, h below the centre of gravity, so that the wheels slip by h phi' more. A sensor on the
body measures a, which has no bank in it, and g phi on top. With `linear` the forces are C_i alpha_i.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.kernels import Array, kernel
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.model_error.logs.measured import PERIOD

SHAPE = 1.1
"""Shape factor C of both axles: a peak that falls by 1 %. Logs hardly tell what is beyond it; a steep fall spins."""
ROLLED = 60
"""Samples before a window over which its roll is found."""
LEAST_GRIP = 0.6
"""Share of an axle's friction that braking and driving leave at least."""


class Values(NamedTuple):
    """Parameters in the kernel's order; stiffness per axle, SI units, rad."""

    C_f: float
    C_r: float
    mu_f: float
    mu_r: float
    e_f: float
    e_r: float
    load_exponent: float
    relaxation: float
    I_z: float
    cg_height: float
    cg_offset: float
    steer_gain: float
    steer_offset: float
    steer_delay: float
    yaw_rate_offset: float
    a_y_offset: float
    roll_gain: float
    sideslip_offset: float
    a_y_delay: float
    v_y_delay: float
    roll_frequency: float
    roll_damping: float


class Chassis(NamedTuple):
    """What is told, SI units: mass and geometry, the drive's share at the rear axle, J / R and J b^2 / R^2."""

    mass: float
    l_f: float
    l_r: float
    rear_drive: float
    gyroscope: float = 0.0
    spinning: float = 0.0

    @classmethod
    def of(cls, vehicle: VehicleParameters, rear_drive: float) -> "Chassis":
        """Of a vehicle file; wheels count if it has suspension data."""
        told = (vehicle.mass, vehicle.l_f, vehicle.l_r, rear_drive)
        if (data := vehicle.suspension) is None:
            return cls(*told)
        spin, half = 4.0 * data.wheel_spin_inertia / data.wheel_radius, 0.25 * (data.track_front + data.track_rear)
        return cls(*told, spin, spin / data.wheel_radius * half**2)


def simulate(
    values: Values, chassis: Chassis, signals: Mapping[str, Array], starts: NDArray[np.int64], steps: int,
    moved: Array, linear: bool,
) -> Array:  # fmt: skip
    """Run every window from its measured start with the measured steering and speed.

    Args:
        values: The car and its sensors.
        chassis: Mass and geometry.
        signals: `steer`, `v_x`, `a_x`, and smoothed `start_yaw_rate` and `start_v_y` (NaN: steady), shape (n,).
        starts: Index of each window's first sample, shape (w,).
        steps: Samples of a window.
        moved: Per window what is added: to v_y [m/s] and yaw rate [rad/s] at the start, and the bank at start and end
            [m/s^2], shape (w, 4).
        linear: Whether the tyres are.

    Returns:
        Yaw rate, lateral acceleration and v_y as the sensors see them, less their delays, shape (w, steps, 3).
    """
    out = np.empty((len(starts), steps, 3))
    _run(
        np.array(values), np.array(chassis), signals["steer"], signals["v_x"], signals["a_x"],
        signals["start_yaw_rate"], signals["start_v_y"], starts, moved, PERIOD, linear, out,
    )  # fmt: skip
    return out


@kernel
def _at(signal, place):
    """Linear between samples, held beyond the ends."""
    last = signal.shape[0] - 1
    if place <= 0.0:
        return signal[0]
    if place >= last:
        return signal[last]
    k = int(place)
    return signal[k] + (place - k) * (signal[k + 1] - signal[k])


@kernel
def _force(slip, stiffness, peak, curvature):
    x = stiffness * slip / (SHAPE * peak)
    return peak * np.sin(SHAPE * np.arctan(x - curvature * (x - np.arctan(x))))


@kernel
def targets(
    p: Array, c: Array, v_x: float, a_x: float, v_y: float, r: float, angle: float, linear: bool
) -> tuple[float, float]:
    """Steady axle forces, in [N]; arguments as of `advance`."""
    mass, l_f, l_r, rear_drive = c[0], c[1], c[2], c[3]
    slip_f, slip_r = angle - np.arctan((v_y + l_f * r) / v_x), -np.arctan((v_y - l_r * r) / v_x)
    if linear:
        return p[0] * slip_f, p[1] * slip_r
    weight, length = mass * GRAVITY, l_f + l_r
    static_f, static_r = weight * l_r / length, weight * l_f / length
    transfer = mass * a_x * p[9] / length
    load_f, load_r = max(static_f - transfer, 0.1 * static_f), max(static_r + transfer, 0.1 * static_r)
    if a_x < 0.0:  # brakes by load: both axles use the same share
        used_f = used_r = a_x / GRAVITY
    else:
        used_f, used_r = (1.0 - rear_drive) * mass * a_x / load_f, rear_drive * mass * a_x / load_r
    grip_f = np.sqrt(max(1.0 - (used_f / p[2]) ** 2, LEAST_GRIP**2))
    grip_r = np.sqrt(max(1.0 - (used_r / p[3]) ** 2, LEAST_GRIP**2))
    stiff_f = p[0] * (1.0 + p[6] * (load_f / static_f - 1.0))
    stiff_r = p[1] * (1.0 + p[6] * (load_r / static_r - 1.0))
    return (
        _force(slip_f, stiff_f, p[2] * grip_f * load_f, p[4]),
        _force(slip_r, stiff_r, p[3] * grip_r * load_r, p[5]),
    )


@kernel
def _rates(p, c, v_x, a_x, r, angle, force_f, force_r, rolling, bank):
    front = force_f * np.cos(angle)
    moment = c[1] * front - c[2] * force_r - c[0] * a_x * p[10] - c[4] * v_x * rolling
    return (front + force_r) / c[0] - v_x * r - bank, moment / (p[8] + c[5])


@kernel
def _steady_v_y(p, c, v_x, r):
    rear = c[0] * c[1] / (c[1] + c[2]) * v_x * r  # force of the rear axle
    return c[2] * r - v_x * rear / p[1]


@kernel
def advance(
    p: Array,
    c: Array,
    state: tuple[float, ...],
    v_x: Array | tuple[float, ...],
    a_x: Array | tuple[float, ...],
    angle: Array | tuple[float, ...],
    bank: Array | tuple[float, ...],
    period: float,
    linear: bool,
) -> tuple[float, ...]:
    """One step by the midpoint rule; the forces' lag is exact for slips that change steadily.

    Args:
        p, c: `Values` and `Chassis` as arrays.
        state: v_y [m/s], yaw rate [rad/s], axle forces [N], roll [rad] and its rate [rad/s], and the steady axle
            forces in the middle of the step before [N].
        v_x, a_x, angle: Speed [m/s], acceleration [m/s^2] and road-wheel angle [rad] at start, middle and end.
        bank: In [m/s^2].
        period: In [s].
        linear: Whether the tyres are.

    Returns:
        The state after it.
    """
    v_y, r, force_f, force_r, roll, rolling, was_f, was_r = state
    aside = 0.0 if linear else p[9]
    half = 0.0 if linear else np.exp(-0.5 * v_x[1] * period / p[7])
    d_v, d_r = _rates(p, c, v_x[0], a_x[0], r, angle[0], force_f, force_r, rolling, bank)
    d_roll = _roll_rate(p, c, force_f, force_r, angle[0], roll, rolling)
    middle_v, middle_r = v_y + 0.5 * period * d_v, r + 0.5 * period * d_r
    middle_roll, middle_rolling = roll + 0.5 * period * rolling, rolling + 0.5 * period * d_roll
    to_f, to_r = targets(p, c, v_x[1], a_x[1], middle_v + aside * middle_rolling, middle_r, angle[1], linear)
    middle_f, end_f = _lagged(force_f, was_f, to_f, v_x[1] * period / p[7], half)
    middle_r_force, end_r = _lagged(force_r, was_r, to_r, v_x[1] * period / p[7], half)
    if linear:
        middle_f, middle_r_force = to_f, to_r
    d_v, d_r = _rates(p, c, v_x[1], a_x[1], middle_r, angle[1], middle_f, middle_r_force, middle_rolling, bank)
    d_roll = _roll_rate(p, c, middle_f, middle_r_force, angle[1], middle_roll, middle_rolling)
    v_y, r = v_y + period * d_v, r + period * d_r
    roll, rolling = roll + period * middle_rolling, rolling + period * d_roll
    if linear:  # no lag: the force is that of the state
        force_f, force_r = targets(p, c, v_x[2], a_x[2], v_y, r, angle[2], linear)
    else:
        force_f, force_r = end_f, end_r
    return v_y, r, force_f, force_r, roll, rolling, to_f, to_r


@kernel
def _lagged(force, was, now, rolled, half):
    """Force in the middle and at the end of a step, whose steady one is a line through `was` and `now`.

    `rolled` is the distance of the step in relaxation lengths, `half` what half of it leaves of a difference.
    """
    slope = now - was
    behind = slope / rolled
    start = force - (now - 0.5 * slope) + behind
    return now - behind + start * half, now + 0.5 * slope - behind + start * half**2


@kernel
def _roll_rate(p, c, force_f, force_r, angle, roll, rolling):
    felt = (force_f * np.cos(angle) + force_r) / c[0]
    return p[20] ** 2 * (p[16] * felt - roll) - 2.0 * p[21] * p[20] * rolling


@kernel
def _rolled(p, speed, start_r, k0, period):
    """Roll and its rate at a window's start: what the turning before it has left."""
    first = max(k0 - ROLLED, 0)
    roll, rolling = p[16] * speed[first] * start_r[first], 0.0
    for k in range(first, k0):
        rolling += period * p[20] ** 2 * (p[16] * speed[k] * (start_r[k] - p[14]) - roll)
        rolling /= 1.0 + 2.0 * period * p[21] * p[20]
        roll += period * rolling
    return roll, rolling


@kernel
def _run(p, c, steer, speed, along, start_r, start_v_y, starts, moved, period, linear, out):
    steps, late = out.shape[1], p[13] / period
    for w in range(starts.shape[0]):
        k0 = starts[w]
        r = start_r[k0] - p[14] + moved[w, 1]
        if np.isnan(start_v_y[k0]):
            v_y = _steady_v_y(p, c, speed[k0], r)
        else:
            v_y = _at(start_v_y, k0 + p[19] / period) - p[17] * speed[k0]
        v_y += moved[w, 0]
        angle = p[11] * _at(steer, k0 - late) + p[12]
        roll, rolling = _rolled(p, speed, start_r, k0, period)
        aside = 0.0 if linear else p[9] * rolling
        force_f, force_r = targets(p, c, speed[k0], along[k0], v_y + aside, r, angle, linear)
        state = (v_y, r, force_f, force_r, roll, rolling, force_f, force_r)
        for k in range(steps):
            i = k0 + k
            bank = moved[w, 2] + (moved[w, 3] - moved[w, 2]) * k / steps
            out[w, k, 0] = state[1] + p[14]
            out[w, k, 1] = (state[2] * np.cos(angle) + state[3]) / c[0] + GRAVITY * state[4] + p[15]
            out[w, k, 2] = state[0] + p[17] * speed[i]
            v_x = (speed[i], _at(speed, i + 0.5), _at(speed, i + 1.0))
            a_x = (along[i], _at(along, i + 0.5), _at(along, i + 1.0))
            middle, end = p[11] * _at(steer, i + 0.5 - late) + p[12], p[11] * _at(steer, i + 1.0 - late) + p[12]
            angles = (angle, middle, end)
            state = advance(p, c, state, v_x, a_x, angles, bank, period, linear)
            angle = end
