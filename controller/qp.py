"""The QP of the MPC (14)-(16), written straight into the solver's matrices.

Decision z = [blocked steering rates, corridor slack, slip slack]; the states are condensed out. What is
bounded are lines: front and rear end of the footprint at the nodes, front and rear slip angle at the nodes.
A line has a lower and an upper bound, of which rarely more than one matters: each gets one row for the side
that the last solution was nearer to, and a second row from a small reserve once a solution violates the other.
When the reserve does not suffice, the problem is solved once more with both rows of every line.
"""

import numpy as np
from numba import njit

from sidestep.controller.prediction import (
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

SLACKS, RESERVE = 2, 8
SLACK_UNIT, SLACK_CURVATURE = 0.01, 1e3
"""Slack is counted in centimetres and hundredths of a radian: with all variables of one order PIQP needs no
preconditioner and half the iterations. The quadratic cost only keeps the QP strictly convex."""
COST_STEP = 0.1
"""Costs are integrals over time, counted per this, in [s]."""
TERMINAL_WEIGHT = 3.0
NOTICED = 0.01
"""Excess over the corridor that is worth a place, in [m]."""


@njit(cache=True, nogil=True)
def condense(x0, speed, car, period, level, block, group, forces, turn_rate, free, response):
    """States at the nodes as free response plus slope in the moves.

    Args:
        x0: Present state, see `prediction`, shape (6,).
        speed: v, in [m/s].
        car: Car.
        period: Shortest step, in [s]; step k lasts period 2^level[k] and uses move block[k] and line group[k].
        level, block, group: Shape (N,).
        forces: Axle forces as lines, see `prediction.linearise`, shape (G, 4).
        turn_rate: Heading rate of the road during each step, shape (N,), in [rad/s].
        free, response: Filled, shapes (N, 6) and (N, 6, moves).
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
            for q in range(block[k] + 1):
                value = 0.0
                for j in range(STATES):
                    value += e[i, j] * slope[j, q]
                response[k, i, q] = value
            response[k, i, block[k]] += e[i, RATE]
        state, slope = free[k], response[k]


@njit(cache=True, nogil=True)
def fill_cost(speed, car, period, level, block, group, forces, path, heading, weights, free, response, P, c):
    """Cost (15): distance and lateral speed to the planned path, lateral acceleration, jerk and rate.

    Args:
        path, heading: Reference offset [m] and heading [rad] at the nodes, shape (N,).
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
        w_l, w_e, w_a = dt * weights.offset, dt * weights.lateral_speed * v * v, dt * weights.acceleration
        r_l, r_e = free[k, 0] - path[k], free[k, 1] - heading[k]
        # a_y is the sum of the axle forces over the mass
        slope_f, force_f, slope_r, force_r = forces[group[k]]
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


@njit(cache=True, nogil=True)
def fill_lines(speed, car, levers, bounds, first, slip_nodes, slip_limits, free, response, lines, slopes, low, high):
    """Bounded lines: footprint ends from node `first` on (slack 0), then slip angles (slack 1).

    Args:
        levers: Front end (positive) and rear end (negative) from the centre of gravity, in [m].
        bounds: right and left at the front, right and left at the rear, shape (4, N), in [m]. Eq. (13).
        slip_nodes: Nodes with slip lines, shape (K,).
        slip_limits: Front and rear, in [rad].
        lines, slopes, low, high: Filled: value without moves, its slope, bounds; shapes (L,), (L, moves), (L,), (L,).
        speed, car, free, response: See `condense`.
    """
    v = max(speed, SLOWEST)
    i = 0
    for k in range(first, free.shape[0]):
        for end in range(2):
            lines[i] = free[k, 0] + levers[end] * free[k, 1]
            slopes[i] = response[k, 0] + levers[end] * response[k, 1]
            low[i], high[i] = bounds[2 * end, k], bounds[2 * end + 1, k]
            i += 1
    for k in slip_nodes:
        lines[i] = free[k, 4] - free[k, 2] - car.l_f / v * free[k, 3]
        slopes[i] = response[k, 4] - response[k, 2] - car.l_f / v * response[k, 3]
        lines[i + 1] = car.l_r / v * free[k, 3] - free[k, 2]
        slopes[i + 1] = car.l_r / v * response[k, 3] - response[k, 2]
        for axle in range(2):
            low[i + axle], high[i + axle] = -slip_limits[axle], slip_limits[axle]
        i += 2


@njit(cache=True, nogil=True)
def fill_rows(moves, corridor_lines, steer_limit, block, lines, slopes, low, high, free, response, G, h_l, h_u):
    """Rows: the nearer bound of every line (soft), the reserve, the commanded angle per move (hard).

    The reserve is empty, or holds the farther bounds if G has room for all of them.

    Args:
        moves: Last solution, shape (moves,).
        corridor_lines: How many lines take the corridor slack; the others take the slip slack.
        steer_limit: In [rad].
        block, lines, slopes, low, high, free, response: See `condense` and `fill_lines`.
        G, h_l, h_u: Filled.
    """
    G[:, :] = 0.0
    count = lines.shape[0]
    reserve = h_u.shape[0] - count - moves.shape[0]
    h_l[count : count + reserve], h_u[count : count + reserve] = -np.inf, 1.0  # empty rows never act
    for i in range(count):
        value = lines[i]
        for q in range(moves.shape[0]):
            value += slopes[i, q] * moves[q]
        upper = value > 0.5 * (low[i] + high[i])
        put_row(i, i, upper, corridor_lines, lines, slopes, low, high, G, h_l, h_u)
        if reserve == count:
            put_row(count + i, i, not upper, corridor_lines, lines, slopes, low, high, G, h_l, h_u)
    row = count + reserve
    for k in range(block.shape[0]):
        if k == block.shape[0] - 1 or block[k + 1] != block[k]:
            for q in range(block[k] + 1):
                G[row, q] = response[k, 5, q]
            h_l[row], h_u[row] = -steer_limit - free[k, 5], steer_limit - free[k, 5]
            row += 1


@njit(cache=True, nogil=True)
def put_row(row, i, upper, corridor_lines, lines, slopes, low, high, G, h_l, h_u):
    """Write one bound of line i into a row: sign (line - bound) <= slack."""
    sign, bound = (1.0, high[i]) if upper else (-1.0, low[i])
    for q in range(slopes.shape[1]):
        G[row, q] = sign * slopes[i, q]
    G[row, slopes.shape[1] + (0 if i < corridor_lines else 1)] = -SLACK_UNIT
    h_l[row], h_u[row] = -np.inf, sign * (bound - lines[i])


@njit(cache=True, nogil=True)
def add_violated(z, used, tolerance, corridor_lines, lines, slopes, low, high, G, h_l, h_u):
    """Move violated bounds that have no row yet into the reserve.

    Args:
        z: Solution, shape (n,).
        used: Reserve rows in use.
        tolerance: Violation that is let pass, in [m] or [rad].
        corridor_lines, lines, slopes, low, high, G, h_l, h_u: See `fill_rows`.

    Returns:
        Reserve rows in use now (more than RESERVE if it did not suffice), the worst excess over the bounds
        of the corridor [m] and of the slip angles [rad], both at least 0, and the line of the first excess
        over the corridor (their number if there is none).
    """
    moves, count = slopes.shape[1], lines.shape[0]
    worst, first = np.zeros(SLACKS), count
    for i in range(count):
        group = 0 if i < corridor_lines else 1
        value = lines[i]
        for q in range(moves):
            value += slopes[i, q] * z[q]
        excess = max(low[i] - value, value - high[i])
        worst[group] = max(worst[group], excess)
        if group == 0 and excess > NOTICED and first == count:
            first = i
        if excess > max(z[moves + group], 0.0) * SLACK_UNIT + tolerance:
            if used < RESERVE:
                put_row(count + used, i, value > high[i], corridor_lines, lines, slopes, low, high, G, h_l, h_u)
            used += 1
    return used, worst[0], worst[1], first
