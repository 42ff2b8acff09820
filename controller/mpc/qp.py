"""The QP of the MPC (14)-(16), written straight into the solver's matrices.

Decision z = [blocked steering rates, corridor slack, slip slack]; the states are condensed out. What is
bounded are lines: front and rear end of the footprint and front and rear slip angle at the nodes (soft), the
commanded angle after each move (hard). Mostly the optimum without any bound keeps them all, and is the optimum.
Else few of them matter: those that the last solution came nearest to get a row, and one of the reserve goes to
each other bound that a solution violates, until none is. When the reserve does not suffice, the problem is
solved once more with both rows of every line.
"""

import numpy as np

from sidestep.controller.mpc.prediction import (
    FRONT,
    RATE,
    REAR,
    SLOWEST,
    STATES,
    TURN,
    WIDTH,
    double,
    exponential,
    model_block,
    steady_gain,
)
from sidestep.plant_models.kernels import kernel

SLACKS = 2
NEAREST, RESERVE = 20, 12
"""Rows to begin with, and to add: another round costs more than twenty rows."""
SLACK_UNIT, SLACK_CURVATURE = 0.01, 1e3
"""Slack is counted in centimetres and hundredths of a radian: with all variables of one order PIQP needs no
preconditioner and half the iterations. The quadratic cost only keeps the QP strictly convex."""
COST_STEP = 0.1
"""Costs are integrals over time, counted per this, in [s]."""
TERMINAL_WEIGHT = 3.0


@kernel
def condense(x0, speed, car, period, level, block, group, forces, turn_rate, free, response):
    """States at the nodes as free response plus slope in the moves.

    Args:
        x0: Present state, see `prediction`, shape (6,).
        speed: v, in [m/s].
        car: Car.
        period: Shortest step, in [s]; step k lasts period 2^level[k] and uses move block[k] and line group[k].
        level, block, group: Shape (N,).
        forces: Axle forces as lines, see `prediction.linearise`, shape (G, 5).
        turn_rate: Heading rate of the road during each step, shape (N,), in [rad/s].
        free, response: Filled, shapes (N, 6) and (N, 6, moves); what later moves would change must be 0 before.
    """
    state, slope = x0, np.zeros((STATES, response.shape[2]))
    e = np.empty((STATES, WIDTH))
    for k in range(level.shape[0]):
        line = forces[group[k]]
        if k == 0 or group[k] != group[k - 1]:
            same = k > 0 and line[0] == forces[group[k - 1], 0] and line[2] == forces[group[k - 1], 2]
            if same and level[k] == level[k - 1] + 1:
                e = double(e)
            elif not (same and level[k] == level[k - 1]):
                e = exponential(model_block(speed, line[0], line[2], car), period * 2.0 ** level[k])
        for i in range(STATES):
            value = e[i, TURN] * turn_rate[k] + e[i, FRONT] * line[1] + e[i, REAR] * line[3]
            for j in range(STATES):
                value += e[i, j] * state[j]
            free[k, i] = value
            l, phi, beta, gamma, delta, told = e[i, 0], e[i, 1], e[i, 2], e[i, 3], e[i, 4], e[i, 5]  # noqa: E741
            for q in range(block[k] + 1):  # written out, the compiler makes vectors of it
                response[k, i, q] = (l * slope[0, q] + phi * slope[1, q] + beta * slope[2, q] + gamma * slope[3, q]
                                     + delta * slope[4, q] + told * slope[5, q])  # fmt: skip
            response[k, i, block[k]] += e[i, RATE]
        state, slope = free[k], response[k]


@kernel
def fill_cost(speed, car, period, level, block, group, forces, path, heading, firmness, weights, free, response, P, c):
    """Cost (15): distance and lateral speed to the planned path, lateral acceleration, jerk and rate.

    Args:
        path, heading: Reference offset [m] and heading [rad] at the nodes, shape (N,).
        firmness: Share of the first two costs at the nodes, shape (N,).
        weights: MpcWeights.
        P, c: Filled.
        speed, car, period, level, block, group, forces, free, response: See `condense`.
    """
    moves = response.shape[2]
    v = max(speed, SLOWEST)
    effort = weights.rate + weights.jerk * steady_gain(v, car) ** 2
    P[:, :] = 0.0
    c[:] = 0.0
    y = np.empty((3, moves))
    for k in range(level.shape[0]):
        dt = period * 2.0 ** level[k] / COST_STEP
        P[block[k], block[k]] += dt * effort
        if k == level.shape[0] - 1:
            dt *= TERMINAL_WEIGHT
        tracking, w_a = dt * firmness[k], dt * weights.acceleration
        w_l, w_e = tracking * weights.offset, tracking * weights.lateral_speed * v * v
        r_l, r_e = free[k, 0] - path[k], free[k, 1] - heading[k]
        # a_y is the sum of the axle forces over the mass
        slope_f, force_f, slope_r, force_r, _ = forces[group[k]]
        a_beta, a_delta = -(slope_f + slope_r) / car.mass, slope_f / car.mass
        a_gamma = (car.l_r * slope_r - car.l_f * slope_f) / (car.mass * v)
        r_a = a_beta * free[k, 2] + a_gamma * free[k, 3] + a_delta * free[k, 4] + (force_f + force_r) / car.mass
        for q in range(block[k] + 1):
            y[0, q], y[1, q] = response[k, 0, q], response[k, 1, q]
            y[2, q] = a_beta * response[k, 2, q] + a_gamma * response[k, 3, q] + a_delta * response[k, 4, q]
        for q in range(block[k] + 1):
            l, e, a = w_l * y[0, q], w_e * y[1, q], w_a * y[2, q]  # noqa: E741
            c[q] += l * r_l + e * r_e + a * r_a
            for r in range(q + 1):
                P[q, r] += l * y[0, r] + e * y[1, r] + a * y[2, r]
    for q in range(moves):
        for r in range(q):
            P[r, q] = P[q, r]
    P[moves, moves] = P[moves + 1, moves + 1] = SLACK_CURVATURE * SLACK_UNIT**2
    c[moves], c[moves + 1] = weights.corridor * SLACK_UNIT, weights.slip * SLACK_UNIT


@kernel
def fill_lines(speed, car, levers, bounds, first, slip_nodes, slip_limits, steer_limit, block, group, forces, free,
               response, lines, slopes, low, high):  # fmt: skip
    """Bounded lines: footprint ends from node `first` on (slack 0), slip angles (slack 1), commanded angles (none).

    Args:
        levers: Front end (positive) and rear end (negative) from the centre of gravity, in [m].
        bounds: right and left at the front, right and left at the rear, shape (4, N), in [m]. Eq. (13).
        slip_nodes: Nodes with slip lines, shape (K,).
        slip_limits: Front and rear, in [rad].
        steer_limit: In [rad].
        lines, slopes, low, high: Filled: value without moves, its slope, bounds; shapes (L,), (L, moves), (L,), (L,).
        speed, car, block, group, forces, free, response: See `condense`.
    """
    v, moves = max(speed, SLOWEST), slopes.shape[1]
    front, rear = car.l_f / v, car.l_r / v
    i = 0
    for k in range(first, free.shape[0]):
        for end in range(2):
            lever = levers[end]
            lines[i] = free[k, 0] + lever * free[k, 1]
            for q in range(moves):
                slopes[i, q] = response[k, 0, q] + lever * response[k, 1, q]
            low[i], high[i] = bounds[2 * end, k], bounds[2 * end + 1, k]
            i += 1
    for k in slip_nodes:
        lines[i], lines[i + 1] = free[k, 4] - free[k, 2] - front * free[k, 3], rear * free[k, 3] - free[k, 2]
        for q in range(moves):
            slopes[i, q] = response[k, 4, q] - response[k, 2, q] - front * response[k, 3, q]
            slopes[i + 1, q] = rear * response[k, 3, q] - response[k, 2, q]
        for axle in range(2):
            aside = forces[group[k], 4]
            low[i + axle], high[i + axle] = aside - slip_limits[axle], aside + slip_limits[axle]
        i += 2
    for k in range(block.shape[0]):
        if k == block.shape[0] - 1 or block[k + 1] != block[k]:
            lines[i], slopes[i] = free[k, 5], response[k, 5]
            low[i], high[i] = -steer_limit, steer_limit
            i += 1


@kernel
def solve_freely(P, c, rate, lines, slopes, low, high, z):
    """Optimum without bounds and slacks, by elimination: P is positive definite and needs no pivots.

    Args:
        P, c: See `fill_cost`.
        rate: Bound on the moves, in [rad/s].
        lines, slopes, low, high: See `fill_lines`.
        z: Filled, shape (n,).

    Returns:
        Whether there is one and it keeps all bounds; as slack only costs, no other z is better then.
    """
    moves = slopes.shape[1]
    a = np.empty((moves, moves + 1))
    for i in range(moves):
        a[i, :moves], a[i, moves] = P[:moves, i], -c[i]
    for k in range(moves):
        if not a[k, k] > 0.0:  # convex on paper only, to the last digit
            return False
        for i in range(k + 1, moves):
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, moves + 1):
                a[i, j] -= factor * a[k, j]
    z[:] = 0.0
    for i in range(moves - 1, -1, -1):
        value = a[i, moves]
        for j in range(i + 1, moves):
            value -= a[i, j] * z[j]
        z[i] = value / a[i, i]
        if abs(z[i]) > rate:
            return False
    for i in range(lines.shape[0]):
        value = lines[i]
        for q in range(moves):
            value += slopes[i, q] * z[q]
        if not low[i] <= value <= high[i]:
            return False
    return True


@kernel
def fill_rows(moves, soft, lines, slopes, low, high, G, h_l, h_u):
    """Rows: the bounds nearest to the last solution and an empty reserve; all bounds if G has room for them.

    Args:
        moves: Last solution, shape (moves,).
        soft: How many lines take the corridor slack, and how many any slack; the others are hard.
        lines, slopes, low, high: See `fill_lines`.
        G, h_l, h_u: Filled.
    """
    G[:, :] = 0.0
    h_l[:], h_u[:] = -np.inf, 1.0  # empty rows never act
    count, rows = lines.shape[0], h_u.shape[0]
    if rows == 2 * count:
        for i in range(count):
            put_row(i, i, True, soft, lines, slopes, low, high, G, h_l, h_u)
            put_row(count + i, i, False, soft, lines, slopes, low, high, G, h_l, h_u)
        return
    below, above = np.empty(count), np.empty(count)
    for i in range(count):
        value = lines[i]
        for q in range(moves.shape[0]):
            value += slopes[i, q] * moves[q]
        below[i], above[i] = value - low[i], high[i] - value  # metres and radians alike
    nearest = np.argsort(np.minimum(below, above))
    for row in range(min(rows - RESERVE, count)):
        i = nearest[row]
        put_row(row, i, above[i] < below[i], soft, lines, slopes, low, high, G, h_l, h_u)


@kernel
def put_row(row, i, upper, soft, lines, slopes, low, high, G, h_l, h_u):
    """Write one bound of line i into a row: sign (line - bound) <= slack."""
    sign, bound = (1.0, high[i]) if upper else (-1.0, low[i])
    moves = slopes.shape[1]
    for q in range(moves):
        G[row, q] = sign * slopes[i, q]
    for slack in range(SLACKS):
        G[row, moves + slack] = -SLACK_UNIT if slack == slack_of(i, soft) else 0.0
    h_u[row] = sign * (bound - lines[i])


@kernel
def slack_of(i, soft):
    """Index of the slack of line i; SLACKS for a hard line."""
    return 0 if i < soft[0] else 1 if i < soft[1] else SLACKS


@kernel
def add_violated(z, used, tolerance, soft, lines, slopes, low, high, G, h_l, h_u):
    """Move violated bounds that have no row yet into the reserve.

    Args:
        z: Solution, shape (n,).
        used: Reserve rows in use.
        tolerance: Violation that is let pass, in [m] or [rad].
        soft, lines, slopes, low, high, G, h_l, h_u: See `fill_rows`.

    Returns:
        Reserve rows in use now (more than RESERVE if it did not suffice), and the worst excess over the bounds
        of the corridor [m] and of the slip angles [rad], both at least 0.
    """
    moves, count = slopes.shape[1], lines.shape[0]
    worst = np.zeros(SLACKS + 1)
    begin = h_u.shape[0] - RESERVE
    for i in range(count):
        slack = slack_of(i, soft)
        value = lines[i]
        for q in range(moves):
            value += slopes[i, q] * z[q]
        excess = max(low[i] - value, value - high[i])
        worst[slack] = max(worst[slack], excess)
        allowed = max(z[moves + slack], 0.0) * SLACK_UNIT if slack < SLACKS else 0.0
        if excess > allowed + tolerance:
            if used < RESERVE:
                put_row(begin + used, i, value > high[i], soft, lines, slopes, low, high, G, h_l, h_u)
            used += 1
    return used, worst[0], worst[1]
