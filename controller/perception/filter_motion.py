"""The filter's prediction: the controller's model of the car, and how uncertainty grows with it.

Axle forces are tangents about the state that the step starts from, and lag behind their slip by the relaxation length,
which makes (v_y, yaw rate) a linear system with a mass matrix: M z' = f(z). It is stepped by the trapezoidal rule,
stable at every speed. Below walking pace slip says nothing: the car then rolls where its wheels point.
"""

import math
from typing import Any

from sidestep.controller.mpc.car_model import tangent
from sidestep.controller.mpc.prediction import tyre_lag
from sidestep.controller.perception.state_estimator import (
    ACTUATOR,
    BIAS,
    SENSOR,
    SHARE,
    STATES,
    STEER,
    V_X,
    V_Y,
    YAW,
    YAW_RATE,
    X,
    Y,
)  # fmt: skip
from sidestep.plant_models.kernels import bare_kernel
from sidestep.plant_models.linear.plant import steered
from sidestep.plant_models.vehicle.parameters import GRAVITY

LONGEST_STEP = 0.02
"""Steps of the prediction are at most this long, in [s], ..."""
MOST_STEPS = 50
"""... but no more than these."""


@bare_kernel
def touch(now: Any, car: Any, c: Any) -> None:
    """Tangents of both axle forces, and the tyres' lag, at the state of a slot."""
    x = now.x
    v = max(x[V_X], c.blend[0])
    front = x[STEER] - (x[V_Y] + car.l_f * x[YAW_RATE]) / v
    rear = -(x[V_Y] - car.l_r * x[YAW_RATE]) / v
    front, rear = front * c.stiffness[0], rear * c.stiffness[1]
    slope_f, now.tangents[1] = tangent(front, c.least[0], car.stiffness_f, car.load_f, car, 0.0)
    slope_r, now.tangents[3] = tangent(rear, c.least[1], car.stiffness_r, car.load_r, car, 0.0)
    now.tangents[0], now.tangents[2] = slope_f * c.stiffness[0], slope_r * c.stiffness[1]
    now.lag = tyre_lag(v, now.tangents[0] + now.tangents[2], car) if car.relaxation > 0.0 else 0.0


@bare_kernel
def balance(now: Any, x: Any, steer: Any, steer_rate: Any, car: Any, c: Any, w: Any) -> None:
    """Fill mass, force and its derivatives of M (v_y', yaw acceleration) = f.

    Args:
        now: Slot with the tangents.
        x: State; its steering angle is not used.
        steer, steer_rate: Road-wheel angle [rad] and rate [rad/s].
        car, c, w: Car, settings, work space.
    """
    v, l_f, l_r = max(x[V_X], c.blend[0]), car.l_f, car.l_r
    slope_f, slope_r = now.tangents[0], now.tangents[2]
    aside_f, aside_r = (x[V_Y] + l_f * x[YAW_RATE]) / v, (x[V_Y] - l_r * x[YAW_RATE]) / v
    force_f = now.tangents[1] + slope_f * (steer - now.lag * steer_rate - aside_f)
    force_r = now.tangents[3] - slope_r * aside_r
    w.axle[0], w.axle[1] = force_f, force_r
    total, moment = (slope_f + slope_r) / v, (l_f * slope_f - l_r * slope_r) / v
    turning = (l_f * l_f * slope_f + l_r * l_r * slope_r) / v
    w.mass[0, 0], w.mass[1, 1] = car.mass - now.lag * total, car.yaw_inertia - now.lag * turning
    w.mass[0, 1] = w.mass[1, 0] = -now.lag * moment
    w.jacobian[0, 0], w.jacobian[0, 1] = -total, -moment - car.mass * x[V_X]
    w.jacobian[1, 0], w.jacobian[1, 1] = -moment, -turning
    w.force[0] = force_f + force_r + car.mass * (GRAVITY * x[SHARE] - x[V_X] * x[YAW_RATE])
    w.force[1] = l_f * force_f - l_r * force_r
    w.by_steer[0], w.by_steer[1] = slope_f, l_f * slope_f
    w.by_speed[0], w.by_speed[1] = -car.mass * x[YAW_RATE], 0.0
    if x[V_X] > c.blend[0]:
        w.by_speed[0] += (slope_f * aside_f + slope_r * aside_r) / v
        w.by_speed[1] += (l_f * slope_f * aside_f - l_r * slope_r * aside_r) / v


@bare_kernel
def sliding(v_x: Any, c: Any) -> Any:
    """How far the sliding car counts, from 0 (it rolls) to 1, and its change with speed, in [s/m]."""
    share = min(max((v_x - c.blend[0]) / (c.blend[1] - c.blend[0]), 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share) / (c.blend[1] - c.blend[0])


@bare_kernel
def _steer(x, new, command, h, car, c, w):
    """The actuator's step; returns its rate. The row says what is left of the angle, and what comes of the offsets."""
    row = w.transition[STEER]
    row[STEER] = 1.0
    if math.isnan(command):
        w.noise[STEER] = c.free_steer**2 * h
        return 0.0
    command = min(max(command + x[ACTUATOR] + x[SENSOR], -c.steer_limit), c.steer_limit)
    new[STEER] = steered(x[STEER], command, h, car.lag, car.rate_limit)
    if abs(command - x[STEER]) <= car.rate_limit * car.lag:
        row[STEER] = math.exp(-h / car.lag)
    elif car.lag <= 1e-3:
        row[STEER] = 0.0
    row[ACTUATOR] = row[SENSOR] = 1.0 - row[STEER]
    return (new[STEER] - x[STEER]) / h


@bare_kernel
def _slide(now, x, h, car, c, w):
    """(v_y, yaw rate) of the sliding car, and their rows."""
    new, steer, lag = now.x, w.transition[STEER], now.lag
    balance(now, x, 0.5 * (x[STEER] + new[STEER]), now.steer_rate, car, c, w)
    a, j = w.mass, w.jacobian
    f_0 = w.force[0] + 0.5 * w.by_speed[0] * (new[V_X] - x[V_X])
    f_1 = w.force[1] + 0.5 * w.by_speed[1] * (new[V_X] - x[V_X])
    a_00, a_01 = a[0, 0] - 0.5 * h * j[0, 0], a[0, 1] - 0.5 * h * j[0, 1]
    a_10, a_11 = a[1, 0] - 0.5 * h * j[1, 0], a[1, 1] - 0.5 * h * j[1, 1]
    scale = h / (a_00 * a_11 - a_01 * a_10)
    i_00, i_01, i_10, i_11 = scale * a_11, -scale * a_01, -scale * a_10, scale * a_00
    new[V_Y] = x[V_Y] + i_00 * f_0 + i_01 * f_1
    new[YAW_RATE] = x[YAW_RATE] + i_10 * f_0 + i_11 * f_1
    side, turn = w.transition[V_Y], w.transition[YAW_RATE]
    by_side_0, by_side_1 = i_00 * w.by_steer[0] + i_01 * w.by_steer[1], i_10 * w.by_steer[0] + i_11 * w.by_steer[1]
    for k in range(2):
        side[V_Y + k] = i_00 * j[0, k] + i_01 * j[1, k]
        turn[V_Y + k] = i_10 * j[0, k] + i_11 * j[1, k]
    side[V_Y] += 1.0
    turn[YAW_RATE] += 1.0
    side[V_X] = i_00 * w.by_speed[0] + i_01 * w.by_speed[1]
    turn[V_X] = i_10 * w.by_speed[0] + i_11 * w.by_speed[1]
    side[SHARE], turn[SHARE] = i_00 * car.mass * GRAVITY, i_10 * car.mass * GRAVITY
    held = 0.5 * (1.0 + steer[STEER]) + lag / h * (1.0 - steer[STEER])
    side[STEER], turn[STEER] = by_side_0 * held, by_side_1 * held
    fresh = 0.5 - lag / h
    for k in (ACTUATOR, SENSOR):
        side[k], turn[k] = by_side_0 * fresh * steer[k], by_side_1 * fresh * steer[k]


@bare_kernel
def _doubt(h, car, c, w):
    """No tyre is the law's: the more force it gives, the less is known of it."""
    front, rear = c.doubt * w.axle[0], c.doubt * w.axle[1]
    w.noise[V_Y] += (front**2 + rear**2) / car.mass**2 * h
    w.noise[YAW_RATE] += ((car.l_f * front) ** 2 + (car.l_r * rear) ** 2) / car.yaw_inertia**2 * h


@bare_kernel
def _roll(x, share, more, car, c, w):
    """Blend with the car that rolls where its wheels point; `share` and `more` as of `sliding`."""
    v, wheelbase = x[V_X], car.l_f + car.l_r
    direction = math.tan(x[STEER])
    wider = (1.0 + direction * direction) / wheelbase
    for state, lever, k in ((V_Y, car.l_r, 0), (YAW_RATE, 1.0, 1)):
        row, steer = w.transition[state], w.transition[STEER]
        by_steer, by_speed = lever * v * wider, lever * direction / wheelbase
        slid, rolled = x[state], by_speed * v
        x[state] = share * slid + (1.0 - share) * rolled
        w.noise[state] = share * w.noise[state] + (1.0 - share) * c.kinematic[k] ** 2
        for i in range(V_X, STATES):
            row[i] = share * row[i] + (1.0 - share) * by_steer * steer[i]
        row[V_X] += (1.0 - share) * by_speed + more * (slid - rolled)


@bare_kernel
def _place(x, new, h, w):
    """Position and yaw by the mean of the velocities, and their rows."""
    t = w.transition
    v_x, v_y = 0.5 * (x[V_X] + new[V_X]), 0.5 * (x[V_Y] + new[V_Y])
    turned = 0.25 * h * (x[YAW_RATE] + new[YAW_RATE])
    new[YAW] = x[YAW] + 2.0 * turned
    cos, sin = math.cos(x[YAW] + turned), math.sin(x[YAW] + turned)
    new[X] = x[X] + h * (v_x * cos - v_y * sin)
    new[Y] = x[Y] + h * (v_x * sin + v_y * cos)
    east, north = -h * (v_x * sin + v_y * cos), h * (v_x * cos - v_y * sin)
    t[YAW, YAW], t[X, X], t[Y, Y] = 1.0, 1.0, 1.0
    for k in range(V_X, STATES):
        t[YAW, k] = 0.5 * h * t[YAW_RATE, k]
    t[YAW, YAW_RATE] += 0.5 * h
    for k in range(YAW, STATES):
        yaw = 0.5 * t[YAW, k] + (0.5 if k == YAW else 0.0)
        along = 0.5 * h * (t[V_X, k] + (1.0 if k == V_X else 0.0))
        side = 0.5 * h * (t[V_Y, k] + (1.0 if k == V_Y else 0.0))
        t[X, k] = east * yaw + cos * along - sin * side
        t[Y, k] = north * yaw + sin * along + cos * side


@bare_kernel
def _grow(P, w):
    """P = transition P transition' + noise, symmetric to the last bit.

    Position adds to itself only, and the disturbances stay.
    """
    t, product = w.transition, w.product
    for i in range(BIAS):
        for j in range(STATES):
            product[i, j] = P[i, j] if i < YAW else 0.0
        for k in range(YAW, STATES):
            for j in range(STATES):
                product[i, j] += t[i, k] * P[k, j]
    for i in range(BIAS):
        for j in range(i + 1):
            total = product[i, j] if j < YAW else 0.0
            for k in range(YAW, STATES):
                total += product[i, k] * t[j, k]
            P[i, j] = P[j, i] = total
        for j in range(BIAS, STATES):
            P[i, j] = P[j, i] = product[i, j]
    for i in range(STATES):
        P[i, i] += w.noise[i]


@bare_kernel
def _step(now, command, acceleration, h, car, c, w):
    """One step of at most LONGEST_STEP, in place."""
    x = w.x
    for i in range(STATES):
        x[i] = now.x[i]
        w.noise[i] = c.walk[i] ** 2 * h
        for j in range(STATES):
            w.transition[i, j] = 0.0
    w.transition[V_X, V_X] = 1.0
    if not math.isnan(acceleration):
        now.x[V_X] = x[V_X] + h * acceleration
    now.steer_rate = _steer(x, now.x, command, h, car, c, w)
    _slide(now, x, h, car, c, w)
    _doubt(h, car, c, w)
    share, more = sliding(now.x[V_X], c)
    if share < 1.0:
        _roll(now.x, share, more, car, c, w)
    _place(x, now.x, h, w)
    _grow(now.P, w)


@bare_kernel
def predict(before: Any, after: Any, car: Any, c: Any, w: Any) -> None:
    """Go from one slot to the time of the next.

    Args:
        before: Slot with state, covariance, tangents, and what is commanded from it on.
        after: Slot whose time is set and not earlier; state, covariance and steering rate are filled.
        car: Record of `CAR`.
        c: Settings, record of `ESTIMATOR`.
        w: Work space, record of `FILTER`.
    """
    after.steer_rate, after.lag = before.steer_rate, before.lag
    for i in range(4):
        after.tangents[i] = before.tangents[i]
    for i in range(STATES):
        after.x[i] = before.x[i]
        for j in range(STATES):
            after.P[i, j] = before.P[i, j]
    passed = after.time - before.time
    if passed <= 0.0:
        return
    steps = int(min(math.ceil(passed / LONGEST_STEP - 1e-6), MOST_STEPS))
    for k in range(steps):
        if k > 0:
            touch(after, car, c)
        _step(after, before.command, before.acceleration, passed / steps, car, c, w)
