"""Where the car is on the road, and where it will be when the next command takes effect."""

import math

import numpy as np

from sidestep.controller.mpc.prediction import advance, along_road
from sidestep.controller.mpc.roll import advance_roll, lateral_acceleration
from sidestep.controller.perception.observer import observe_disturbance
from sidestep.controller.records import STATES
from sidestep.plant_models.kernels import Array, Record, kernel
from sidestep.plant_models.road.clothoid import curvature_at, project_at

OBSERVED_SPEED = 3.0
"""Speed below which nothing is learned: sideslip is not defined well, in [m/s]."""


@kernel
def locate(m: Record, w: Record, c: Record, road: tuple[Array, float], state: Record) -> None:
    """Station, prediction state and roll at the time when the next command takes effect.

    Args:
        m: Memory; learns from how the last step really went.
        w: Work space; `station`, `time`, `x0`, `roll` and `disturbance` are filled.
        c: Settings.
        road: Table and period of the ReferencePath.
        state: Record of `STATE`.
    """
    x, car, v = w.x0, c.car, state.v_x
    s, l, heading = project_at(road[0], road[1], state.x, state.y, m.station)  # noqa: E741
    m.station = s
    if m.on_the_way == 0:
        m.on_the_way = c.delay + 1
        m.sent[: m.on_the_way] = state.steer_angle
    x[0], x[1], x[2] = l, turned(state.yaw - heading), state.v_y / max(v, 1.0)
    x[3], x[4], x[5] = state.yaw_rate, state.steer_angle, m.sent[0]
    _observe(m, w, c, state)
    offset = m.disturbance.actuator + m.disturbance.sensor
    w.disturbance[0], w.disturbance[1] = m.disturbance.share * car.load_f, m.disturbance.share * car.load_r
    x[4] += m.disturbance.sensor
    x[5] = _within(x[5] + offset, car.steer_limit)
    w.roll[0], w.roll[1], w.station, w.time = m.roll[0], m.roll[1], s, state.time
    if m.on_the_way == 1:
        return
    w.time = state.time + c.period * (m.on_the_way - 1)
    progress = along_road(v, curvature_at(road[0], road[1], s), x[0], x[1] + x[2])
    w.station = s + progress * c.period * (m.on_the_way - 1)
    turn_rate = progress * curvature_at(road[0], road[1], w.station)
    for i in range(1, m.on_the_way):
        command = _within(m.sent[i] + offset, car.steer_limit)
        advance(x, w.roll, (v, turn_rate), w.disturbance, command, c.period, car, w.runge_kutta)


@kernel
def _observe(m, w, c, state):
    """Learn from how the last step really went."""
    passed, angle, rate = state.time - m.before_time, m.roll[0], m.roll[1]
    m.roll[0] = m.roll[1] = 0.0
    if 0.5 * c.period < passed < 1.5 * c.period and state.v_x >= OBSERVED_SPEED:
        m.before[5] = m.sent[0]  # what was in force since
        if c.rolls:
            lateral = lateral_acceleration(m.before, w.x0, state.v_x, passed)
            m.roll[0], m.roll[1] = advance_roll(angle, rate, lateral, passed, c.car.body)
        if c.rejects:
            observe_disturbance(m.disturbance, m.before, w.x0, m.roll, state.v_x, passed, c)
    m.before_time = state.time
    for i in range(STATES):
        m.before[i] = w.x0[i]


@kernel
def turned(angle: float) -> float:
    """An angle less its whole turns, in [rad]."""
    return angle - math.tau * np.rint(angle / math.tau)


@kernel
def _within(angle, limit):
    return min(max(angle, -limit), limit)
