"""Prediction model of the MPC: Eq. (5) with affine axle forces and the steering actuator, discretised exactly.

State x = [l_s, e_phi, beta, gamma, delta, delta_c]: the paper's four plus realised and commanded road-wheel
angle. Held inputs w = [u, road turn rate, front force, rear force]: the steering rate u = delta_c' (a ramp
within each step), the heading rate of the road, and the axle forces at zero slip.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.mpc.car_model import axle_force, least_slope, slip_angles, tangent
from sidestep.controller.mpc.roll import advance_roll, felt, lateral_acceleration
from sidestep.plant_models.kernels import kernel

STATES, WIDTH = 6, 10
RATE, TURN, FRONT, REAR = 6, 7, 8, 9
"""Columns of the inputs."""
HORIZON, COARSEST_STEP = 2.58, 0.16
"""Length of the prediction and of its longest step, in [s]."""
SLOWEST = 1.0
"""Speed below which the model keeps the dynamics of this speed, in [m/s]: Eq. (5) divides by v."""
_R = math.sqrt(177.0)
_X3 = 2.0 / 3.0
_X1, _X2 = _X3 * (1.0 + _R) / 88.0, _X3 * (1.0 + _R) / 352.0
_X4, _X5 = (-271.0 + 29.0 * _R) / (315.0 * _X3), 11.0 * (-1.0 + _R) / (1260.0 * _X3)
_X6, _X7 = 11.0 * (-9.0 + _R) / (5040.0 * _X3), (89.0 - _R) / (5040.0 * _X3**2)
_Y2 = (857.0 - 58.0 * _R) / 630.0
"""Of the polynomial in `exponential`."""
SIMULATION_STEP = 5e-3
"""Step of the nonlinear forward simulation, in [s]."""


class Prediction(NamedTuple):
    """States ahead as an earlier step saw them.

    Attributes:
        times, states: Shapes (K,), in [s] from then, and (K, 6).
        roll: Roll angle and rate, shape (K, 2), in [rad] and [rad/s]; positive to the right.
        age: Time since then, in [s].
    """

    times: NDArray[np.float64]
    states: NDArray[np.float64]
    roll: NDArray[np.float64]
    age: float

    @classmethod
    def lasting(cls, x0: NDArray[np.float64]) -> "Prediction":
        """What the first step goes by: the present state, shape (6,), for ever."""
        return cls(np.zeros(1), x0[None], np.zeros((1, 2)), 0.0)


@kernel
def model_block(speed, slope_f, slope_r, car):
    """Generator of [x; w]: the upper rows of [[A, B], [0, 0]].

    Args:
        speed: v, in [m/s].
        slope_f, slope_r: Slope of the axle forces, in [N/rad].
        car: Car.

    Returns:
        Shape (6, 10).
    """
    v = max(speed, SLOWEST)
    m, i_z, l_f, l_r = car.mass, car.yaw_inertia, car.l_f, car.l_r
    moment = l_f * slope_f - l_r * slope_r
    a = np.zeros((STATES, WIDTH))
    a[0, 1] = a[0, 2] = v
    a[1, 3], a[1, TURN] = 1.0, -1.0
    a[2, 2], a[2, 3], a[2, 4] = -(slope_f + slope_r) / (m * v), -moment / (m * v * v) - 1.0, slope_f / (m * v)
    a[2, FRONT] = a[2, REAR] = 1.0 / (m * v)
    a[3, 2], a[3, 3] = -moment / i_z, -(l_f * l_f * slope_f + l_r * l_r * slope_r) / (i_z * v)
    a[3, 4], a[3, FRONT], a[3, REAR] = l_f * slope_f / i_z, l_f / i_z, -l_r / i_z
    if car.lag > 1e-3:
        a[4, 4], a[4, 5] = -1.0 / car.lag, 1.0 / car.lag
    else:
        a[4, RATE] = 1.0
    a[5, RATE] = 1.0
    if car.relaxation > 0.0:
        _relax(a, v, slope_f, slope_r, car)
    return a


@kernel
def tyre_lag(v, slopes, car):
    """Time until forces follow slip, in [s].

    To first order that holds while it is short beside the car's own time constant, and matters there; below some
    8 m/s, where it is not short, it fades out.

    Args:
        v: Speed, in [m/s].
        slopes: Of both axle forces together, in [N/rad].
        car: Car.
    """
    lag = car.relaxation / v
    return lag / (1.0 + (2.0 * lag * slopes / (car.mass * v)) ** 2)


@kernel
def _relax(a, v, slope_f, slope_r, car):
    """Let axle forces lag behind their slip angles by the time the tyres take to roll their relaxation length.

    To first order, F = C (alpha - lag alpha'), which needs no states of its own: solved for beta' and gamma'.
    """
    m, i_z, l_f, l_r, total = car.mass, car.yaw_inertia, car.l_f, car.l_r, slope_f + slope_r
    lag = tyre_lag(v, total, car)
    moment = l_f * slope_f - l_r * slope_r
    own_b, own_r = 1.0 - lag * total / (m * v), 1.0 - lag * (l_f**2 * slope_f + l_r**2 * slope_r) / (i_z * v)
    cross_b, cross_r = -lag * moment / (m * v * v), -lag * moment / i_z
    determinant = own_b * own_r - cross_b * cross_r
    for j in range(WIDTH):
        late = lag * slope_f * a[4, j]  # what steering on the way is still short of
        b, r = a[2, j] - late / (m * v), a[3, j] - late * l_f / i_z
        a[2, j], a[3, j] = (own_r * b - cross_b * r) / determinant, (own_b * r - cross_r * b) / determinant


@kernel
def _multiply(a, b, identity, out):
    """Product of upper blocks: of [[a], [0, identity]] with [[b], [0, identity]]; with b's only, if a's is 0."""
    for i in range(STATES):
        for j in range(WIDTH):
            out[i, j] = identity * a[i, j] if j >= STATES else 0.0
        for k in range(STATES):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(WIDTH):
                    out[i, j] += factor * b[k, j]


@kernel
def exponential(a, dt):
    """Upper rows of the exponential of [[a], [0]] dt by scaling, an eighth-order Taylor polynomial and squaring.

    The scaled norm stays below 1/4, which leaves a truncation error below 1e-11. The polynomial takes three
    products only: Bader, Blanes and Casas, Mathematics 7 (2019) 1174, Section 3.

    Args:
        a: Generator, shape (6, 10).
        dt: In [s].

    Returns:
        [A_k, B_k], shape (6, 10).
    """
    norm = 0.0
    for i in range(STATES):
        row = 0.0
        for j in range(STATES):
            row += abs(a[i, j])
        norm = max(norm, row * dt)
    squarings = 0
    while norm > 0.25:
        norm *= 0.5
        squarings += 1
    x = a * (dt / 2.0**squarings)
    x2, x4, e, product = (np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty_like(x))
    _multiply(x, x, 0.0, x2)
    for i in range(STATES):
        for j in range(WIDTH):
            product[i, j] = _X1 * x[i, j] + _X2 * x2[i, j]
    _multiply(x2, product, 0.0, x4)
    for i in range(STATES):
        for j in range(WIDTH):
            product[i, j] = _X5 * x[i, j] + _X6 * x2[i, j] + _X7 * x4[i, j]
            x4[i, j] += _X3 * x2[i, j]
    _multiply(x4, product, 0.0, e)
    for i in range(STATES):
        for j in range(WIDTH):
            e[i, j] += x[i, j] + _Y2 * x2[i, j] + _X4 * x4[i, j]
        e[i, i] += 1.0
    for _ in range(squarings):
        _multiply(e, e, 1.0, product)
        e, product = product, e
    return e


@kernel
def double(e):
    """[A_k, B_k] of twice the step."""
    out = np.empty((STATES, WIDTH))
    _multiply(e, e, 1.0, out)
    return out


@kernel
def linearise(times, states_time, states, roll, speed, disturbance, car, lines):
    """Axle forces as lines through the slip angles of an earlier prediction.

    Args:
        times: When the lines are needed, in the clock of that prediction, shape (G,), in [s].
        states_time, states, roll: That prediction, shapes (K,), (K, 6) and (K, 2).
        speed: v, in [m/s].
        disturbance: Forces to add at front and rear axle, in [N].
        car: Car.
        lines: Filled: slope and force at zero slip, front and rear, in [N/rad] and [N], and what roll takes
            from both slip angles, in [rad]; shape (G, 5).
    """
    v = max(speed, SLOWEST)
    least_f, least_r = least_slope(car.stiffness_f, car.load_f, car), least_slope(car.stiffness_r, car.load_r, car)
    for g in range(times.shape[0]):
        i = min(np.searchsorted(states_time, times[g]), states_time.shape[0] - 1)
        state, rolled = states[i], roll[i]
        if i > 0:
            part = min((times[g] - states_time[i - 1]) / (states_time[i] - states_time[i - 1]), 1.0)
            state, rolled = states[i - 1] + part * (state - states[i - 1]), roll[i - 1] + part * (rolled - roll[i - 1])
        aside, moved_f, moved_r = felt(rolled[0], rolled[1], car.body)
        aside /= v
        front, rear = slip_angles(state[2] + aside, state[3], state[4], v, car)
        slope_f, force_f = tangent(front, least_f, car.stiffness_f, car.load_f, car, moved_f)
        slope_r, force_r = tangent(rear, least_r, car.stiffness_r, car.load_r, car, moved_r)
        lines[g, 0], lines[g, 1] = slope_f, force_f - slope_f * aside + disturbance[0]
        lines[g, 2], lines[g, 3] = slope_r, force_r - slope_r * aside + disturbance[1]
        lines[g, 4] = aside


@kernel
def _rates(x, feels, v, turn_rate, disturbance, command, car):
    front, rear = slip_angles(x[2] + feels[0] / v, x[3], x[4], v, car)
    force_f = axle_force(front, car.stiffness_f, car.load_f, car, feels[1]) + disturbance[0]
    force_r = axle_force(rear, car.stiffness_r, car.load_r, car, feels[2]) + disturbance[1]
    rates = np.empty(STATES)
    rates[0] = v * (x[1] + x[2])
    rates[1] = x[3] - turn_rate
    rates[2] = (force_f + force_r) / (car.mass * v) - x[3]
    rates[3] = (car.l_f * force_f - car.l_r * force_r) / car.yaw_inertia
    if car.lag > 1e-3:
        rates[4] = min(max((command - x[4]) / car.lag, -car.rate_limit), car.rate_limit)
    else:
        rates[4] = 0.0
    rates[5] = 0.0
    return rates


@kernel
def advance(state, roll, speed, turn_rate, disturbance, commands, period, car):
    """Simulate the nonlinear model through commands that are already on their way (RK4).

    Args:
        state: Shape (6,).
        roll: Roll angle and rate, in [rad] and [rad/s].
        speed, turn_rate: Of the car, in [m/s], and of the road, in [rad/s]; held.
        disturbance: Forces to add at front and rear axle, in [N].
        commands: Angles in the order in which they take effect, shape (d,), in [rad].
        period: How long each command is held, in [s].
        car: Car.

    Returns:
        State, shape (6,), and roll after d periods.
    """
    x, v = state.copy(), max(speed, SLOWEST)
    fastest = (car.stiffness_f + car.stiffness_r) / (car.mass * v)  # of the poles at zero slip, nearly
    steps = math.ceil(period * max(1.0 / SIMULATION_STEP, fastest))
    h = period / steps
    for command in commands:
        x[5] = command
        if car.lag <= 1e-3:
            x[4] = command
        for _ in range(steps):
            feels = felt(roll[0], roll[1], car.body)
            k1 = _rates(x, feels, v, turn_rate, disturbance, command, car)
            k2 = _rates(x + 0.5 * h * k1, feels, v, turn_rate, disturbance, command, car)
            k3 = _rates(x + 0.5 * h * k2, feels, v, turn_rate, disturbance, command, car)
            k4 = _rates(x + h * k3, feels, v, turn_rate, disturbance, command, car)
            before, x = x, x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            roll = advance_roll(roll[0], roll[1], lateral_acceleration(before, x, v, h), h, car.body)
    return x, roll


@kernel
def steady_gain(speed, car):
    """Steady lateral acceleration per road-wheel angle, v^2 / (L + K v^2), in [m/s^2/rad], of the linear car."""
    wheelbase = car.l_f + car.l_r
    understeer = car.mass / wheelbase * (car.l_r / car.stiffness_f - car.l_f / car.stiffness_r)
    return speed * speed / max(wheelbase + understeer * speed * speed, 0.2 * wheelbase)


def grid(period: float) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Prediction grid: fine where the car is, coarse ahead, every step the first times a power of two.

    Args:
        period: Control period, in [s].

    Returns:
        level (N,) such that step k lasts period 2^level[k], the control move (N,) that acts in it, and the
        group (N,) of steps, of one level each, that share their axle forces: no longer than the coarsest step.
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
    steps = np.array(level)
    since = np.arange(len(steps)) - np.searchsorted(steps, steps)  # steps of this level before
    group = np.cumsum((since % 2 ** (coarsest - steps) == 0).astype(np.int64)) - 1
    return steps, block, group
