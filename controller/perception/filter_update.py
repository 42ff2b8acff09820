"""The filter's update: one signal after another, each behind a gate, in Joseph's form."""

import math
from typing import Any

from sidestep.controller.perception.filter_motion import balance, sliding, touch
from sidestep.controller.perception.state_estimator import (
    BIAS,
    LATERAL,
    SENSOR,
    SHARE,
    SIGNALS,
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
from sidestep.plant_models.vehicle.parameters import GRAVITY

NONE, USED, REJECTED, FORCED = range(4)
"""Verdicts: not measured; used; does not fit; used although it does not fit, as nothing else has for long."""


@bare_kernel
def expect(now: Any, signal: Any, car: Any, c: Any, w: Any) -> Any:
    """What a signal should show at the state of a slot; its row is filled."""
    x, row = now.x, w.row
    for i in range(STATES):
        row[i] = 0.0
    if signal == LATERAL:
        return _lateral_force(now, car, c, w)
    row[signal] = 1.0
    if signal == YAW_RATE:
        row[BIAS] = 1.0
        return x[YAW_RATE] + x[BIAS]
    if signal == STEER:
        row[SENSOR] = -1.0
        return x[STEER] - x[SENSOR]
    return x[signal]


@bare_kernel
def _lateral_force(now, car, c, w):
    """The accelerometer: v_y' + v_x yaw rate + lever yaw acceleration, less what gravity does."""
    x, row = now.x, w.row
    balance(now, x, x[STEER], now.steer_rate, car, c, w)
    m, (share, more) = w.mass, sliding(x[V_X], c)
    scale = 1.0 / (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0])
    side = scale * (m[1, 1] - c.lever * m[1, 0])  # of the lateral force, then of the moment
    turn = scale * (c.lever * m[0, 0] - m[0, 1])
    slid = side * w.force[0] + turn * w.force[1]
    side, turn = share * side, share * turn
    row[V_Y] = side * w.jacobian[0, 0] + turn * w.jacobian[1, 0]
    row[YAW_RATE] = side * w.jacobian[0, 1] + turn * w.jacobian[1, 1] + x[V_X]
    row[STEER] = side * w.by_steer[0] + turn * w.by_steer[1]
    row[V_X] = side * w.by_speed[0] + turn * w.by_speed[1] + more * slid + x[YAW_RATE]
    row[SHARE] = (side * car.mass - 1.0) * GRAVITY
    return share * slid + x[V_X] * x[YAW_RATE] - GRAVITY * x[SHARE]


@bare_kernel
def _misfit(now, signal, expected):
    value = now.z[signal] - expected
    return value - math.tau * math.floor(value / math.tau + 0.5) if signal == YAW else value


@bare_kernel
def _spread(P, w):
    """P times the row into the column; the row times that."""
    total = 0.0
    for i in range(STATES):
        w.column[i] = 0.0
    for k in range(STATES):
        if w.row[k] != 0.0:
            for i in range(STATES):
                w.column[i] += w.row[k] * P[k, i]
    for i in range(STATES):
        total += w.row[i] * w.column[i]
    return total


@bare_kernel
def _correct(now, innovation, spread, variance, w):
    """X += K innovation, P = (1 - K row) P (1 - K row)' + K variance K'."""
    P, gain, column = now.P, w.gain, w.column
    for i in range(STATES):
        gain[i] = column[i] / (spread + variance)
        now.x[i] += gain[i] * innovation
    for i in range(STATES):
        left = column[i] - gain[i] * spread  # of the column
        for j in range(STATES):
            P[i, j] += (gain[i] * variance - left) * gain[j] - gain[i] * column[j]
    for i in range(STATES):
        for j in range(i):
            P[j, i] = P[i, j]


@bare_kernel
def _forget(now, signal, c):
    """Know nothing any more of what a signal shows."""
    i = SHARE if signal == LATERAL else signal
    for j in range(STATES):
        now.P[i, j] = now.P[j, i] = 0.0
    now.P[i, i] = c.start[i] ** 2


@bare_kernel
def use(now: Any, signal: Any, car: Any, c: Any, w: Any) -> None:
    """Correct a slot by one of its signals, as its verdict says."""
    if now.verdict[signal] == FORCED:
        _forget(now, signal, c)
        if signal == YAW:
            now.x[YAW] = now.z[YAW]
    innovation = _misfit(now, signal, expect(now, signal, car, c, w))
    _correct(now, innovation, _spread(now.P, w), c.noise[signal] ** 2, w)


@bare_kernel
def _look(e, now, signal, car, c, w):
    """Write down a signal's innovation and its variance; row and column are filled. Returns P's part of it."""
    e.innovation[signal] = _misfit(now, signal, expect(now, signal, car, c, w))
    spread = _spread(now.P, w)
    e.innovation_variance[signal] = spread + c.noise[signal] ** 2
    return spread


@bare_kernel
def _judge(e, signal, fits, c):
    """Verdict of one signal, counted."""
    if e.misfits[signal] >= c.patience:
        e.misfits[signal] = 0
        return FORCED
    if fits:
        e.misfits[signal] = 0
        return USED
    e.misfits[signal] += 1
    e.rejected[signal] += 1
    return REJECTED


@bare_kernel
def _take(e, now, signal, car, c, w):
    """Judge one signal by itself, and correct the slot."""
    spread = _look(e, now, signal, car, c, w)
    square = e.innovation[signal] ** 2 / e.innovation_variance[signal]
    now.verdict[signal] = _judge(e, signal, square <= c.gate[0], c)
    if now.verdict[signal] == FORCED:
        use(now, signal, car, c, w)
        return
    e.nis += square
    e.degrees += 1
    if now.verdict[signal] == USED:
        _correct(now, e.innovation[signal], spread, c.noise[signal] ** 2, w)


@bare_kernel
def _take_position(e, now, car, c, w):
    """Judge both coordinates together: a fix is good or it is not."""
    _look(e, now, X, car, c, w)
    _look(e, now, Y, car, c, w)
    a, b, d = e.innovation_variance[X], now.P[X, Y], e.innovation_variance[Y]
    u, v = e.innovation[X], e.innovation[Y]
    square = (d * u * u - 2.0 * b * u * v + a * v * v) / (a * d - b * b)
    for signal in (X, Y):
        now.verdict[signal] = _judge(e, signal, square <= c.gate[1], c)
        if now.verdict[signal] != REJECTED:
            use(now, signal, car, c, w)
    if now.verdict[X] != FORCED:
        e.nis += square
        e.degrees += 2


@bare_kernel
def update(e: Any, now: Any, car: Any, c: Any, w: Any) -> None:
    """Judge every signal of a slot and correct it by those that fit.

    Args:
        e: Record of `ESTIMATE`; counts.
        now: Slot with predicted state and covariance, and signals; corrected, verdicts and tangents are filled.
        car: Record of `CAR`.
        c: Settings, record of `ESTIMATOR`.
        w: Work space, record of `FILTER`.
    """
    e.nis, e.degrees = 0.0, 0
    for signal in range(SIGNALS):
        now.verdict[signal] = NONE
        e.innovation[signal] = e.innovation_variance[signal] = math.nan
    whole = math.isfinite(now.z[X]) and math.isfinite(now.z[Y])
    if whole:
        _take_position(e, now, car, c, w)
    for signal in range(YAW if whole else X, SIGNALS):
        if signal == LATERAL:
            touch(now, car, c)
        if math.isfinite(now.z[signal]):
            _take(e, now, signal, car, c, w)


@bare_kernel
def update_again(now: Any, car: Any, c: Any, w: Any) -> None:
    """Correct a slot by the signals that were used before: what was decided stays."""
    for signal in range(SIGNALS):
        if signal == LATERAL:
            touch(now, car, c)
        if now.verdict[signal] == USED or now.verdict[signal] == FORCED:
            use(now, signal, car, c, w)
