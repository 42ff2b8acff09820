"""From the QP's solution to plan and command, and what is answered when there is none."""

import math

from sidestep.controller.mpc.prediction import SLOWEST, sampled
from sidestep.controller.mpc.roll import roll_ahead
from sidestep.controller.mpc.unconstrained import line_value
from sidestep.controller.records import SLACKS, STATES
from sidestep.controller.speed import STANDSTILL, choose_speed
from sidestep.plant_models.kernels import Record, kernel
from sidestep.plant_models.signals import Status

FEASIBLE_SLACK = 1e-3
"""Corridor slack up to which a step counts as feasible, in [m]."""
SHIFTED_PLAN_TIME = 0.2
"""How long the last good plan is followed when the QP fails, in [s]; longer than that is a FAULT."""
TRACKING, DEGRADED, BLOCKED, FAULT = (int(status) for status in Status)


@kernel
def take(m: Record, w: Record, c: Record, solved: bool) -> None:
    """States along the moves of `z`, and how far they leave the soft bounds."""
    grid = c.grid
    for i in range(STATES):
        w.states[0, i] = w.x0[i]
    for k in range(grid.nodes):
        for i in range(STATES):
            value = w.free[k, i]
            for q in range(grid.moves):
                value += w.response[k, i, q] * w.z[q]
            w.states[k + 1, i] = value
    w.slack_corridor = w.slack_slip = 0.0
    if solved:
        for q in range(grid.moves):
            m.moves[q] = w.z[q]
    for i in range(w.count):
        if w.slack[i] < SLACKS:
            value = line_value(i, w, grid.moves)
            excess = max(w.low[i] - value, value - w.high[i])
            if w.slack[i] == 0:
                w.slack_corridor = max(w.slack_corridor, excess)
            else:
                w.slack_slip = max(w.slack_slip, excess)


@kernel
def answer(m: Record, w: Record, c: Record, state: Record, solved: bool) -> None:
    """Fill the plan and the command.

    Args:
        m: Memory.
        w: Work space with states, solver's figures and the gap to what blocks the road.
        c: Settings.
        state: Record of `STATE`.
        solved: Whether the solver found an optimum.
    """
    plan, n, v = m.plans[1 - max(m.good, 0)], c.grid.nodes, state.v_x
    target, acceleration, distance = choose_speed(m, w, c, v)
    if v < STANDSTILL:
        for k in range(1, n + 1):
            w.states[k, 5] = w.x0[5]
    feasible = solved and w.slack_corridor <= FEASIBLE_SLACK
    tracking = feasible and w.slack_slip <= FEASIBLE_SLACK
    plan.time, plan.status = state.time, BLOCKED if w.blocked else TRACKING if tracking else DEGRADED
    plan.states_s[0], total = w.station, 0.0
    for k in range(n + 1):
        for i in range(STATES):
            plan.states[k, i] = w.states[k, i]
            total += w.states[k, i]
        if k > 0:
            plan.states_s[k] = w.station + w.stations[k - 1]
    if c.rolls:
        roll_ahead(w.roll, c.grid, w.states, max(v, SLOWEST), c.car.body, plan.roll)
    plan.solver_status, plan.iterations = w.solver_status, w.iterations
    plan.primal_residual, plan.dual_residual = w.primal_residual, w.dual_residual
    plan.slack_corridor, plan.slack_slip, plan.feasible = w.slack_corridor, w.slack_slip, feasible
    plan.stop_distance, plan.target_speed, plan.acceleration = distance, target, acceleration
    m.last = 1 - max(m.good, 0)
    if solved and math.isfinite(total):
        m.good = m.last
        _command(m, c)
    else:
        fall_back(m, c, state.time, w.solver_status, True)


@kernel
def fall_back(m: Record, c: Record, now: float, solver_status: int, failed: bool) -> None:
    """The last good plan shifted to now; when that is too old, hold the angle and slow down.

    Args:
        m: Memory.
        c: Settings.
        now: Time of the answer, in [s].
        solver_status: Why.
        failed: Whether the plan that is not good has been filled by this step.
    """
    good, plan, n = m.plans[max(m.good, 0)], m.plans[1 - max(m.good, 0)], c.grid.nodes
    if not failed:
        m.plans[1 - max(m.good, 0)] = m.plans[max(m.good, 0)]
    age = now - good.time if m.good >= 0 else math.inf
    if age <= SHIFTED_PLAN_TIME + 1e-9:
        for k in range(n + 1):
            later = (c.grid.times[k - 1] if k > 0 else 0.0) + age
            for i in range(STATES):
                plan.states[k, i] = sampled(good.states, i, later, c.grid)
        plan.status = DEGRADED
        if not plan.target_speed < good.target_speed:
            plan.target_speed = good.target_speed
        if not plan.acceleration < good.acceleration:
            plan.acceleration = good.acceleration
    else:
        held = m.command.steer_angle if m.commanded else 0.0
        for k in range(n + 1):
            for i in range(STATES):
                if i >= 4:
                    plan.states[k, i] = held + m.disturbance.actuator + m.disturbance.sensor
        slower = (m.command.target_speed if m.commanded else 0.0) - c.comfort_braking * c.period
        plan.status, plan.target_speed, plan.acceleration = FAULT, max(slower, 0.0), -c.comfort_braking
    plan.time, plan.solver_status, plan.feasible = now, solver_status, False
    _make_finite(plan, n)
    m.last = 1 - max(m.good, 0)
    _command(m, c)


@kernel
def _make_finite(plan, n):
    """What a failed solve left is shown as zero where it is no number."""
    for k in range(n + 1):
        for i in range(STATES):
            if not math.isfinite(plan.states[k, i]):
                plan.states[k, i] = 0.0
        for i in range(2):
            if not math.isfinite(plan.roll[k, i]):
                plan.roll[k, i] = 0.0
    if not math.isfinite(plan.slack_corridor + plan.slack_slip):
        plan.slack_corridor = plan.slack_slip = 0.0
    if not math.isfinite(plan.primal_residual + plan.dual_residual):
        plan.primal_residual = plan.dual_residual = 0.0


@kernel
def _command(m, c):
    """The plan's angle one period ahead, less what the wheels have anyway, as the command to send."""
    plan, limit = m.plans[m.last], c.car.steer_limit
    angle = plan.states[1, 5] - (m.disturbance.actuator + m.disturbance.sensor)
    if m.commanded and not c.grid.literal:  # a plan of another moment or offset must not make the wheels jump
        most = c.car.rate_limit * c.period
        angle = min(max(angle, m.command.steer_angle - most), m.command.steer_angle + most)
    angle = min(max(angle, -limit), limit)
    m.command.time, m.command.steer_angle = plan.time, angle
    m.command.acceleration, m.command.target_speed = plan.acceleration, plan.target_speed
    m.command.status, m.commanded = plan.status, True
    if m.on_the_way > 0:
        for i in range(1, m.on_the_way):
            m.sent[i - 1] = m.sent[i]
        m.sent[m.on_the_way - 1] = angle
