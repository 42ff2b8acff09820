"""The QP and its solution: KKT conditions, an exact solver, finite differences, PIQP's traps."""

import daqp
import numpy as np
import piqp
import pytest

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.controller.mpc.car_model import Car
from sidestep.controller.mpc.mpc import UNCONSTRAINED, Limits, Mpc, MpcWeights
from sidestep.controller.mpc.prediction import (
    FRONT,
    RATE,
    REAR,
    TURN,
    Prediction,
    exponential,
    model_block,
    steady_gain,
)
from sidestep.controller.mpc.qp import SLACK_CURVATURE, SLACK_UNIT, SLACKS, solve_freely
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Line
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
WEIGHTS = MpcWeights(4.0, 0.4, 0.05, 2e-3, 0.5, 300.0, 300.0)
LIMITS = Limits(BMW.steer_limit, BMW.steer_rate_limit, (BMW.front_extent, -BMW.rear_extent))
DOUBLE = (Obstacle(40.0, -0.6, 4.5, 1.8), Obstacle(70.0, 0.8, 4.5, 1.8))


CAR = Car.of(BMW, True, 1.0)


def make():
    return Mpc(0.02, WEIGHTS, LIMITS)


def case(mpc, seed):
    rng = np.random.default_rng(seed)
    n = len(mpc.times)
    x0 = rng.normal(0.0, [0.5, 0.05, 0.02, 0.1, 0.03, 0.03])
    middle, width = rng.normal(0.0, 0.5, (2, n)).cumsum(axis=1) * 0.1, rng.uniform(0.2, 2.0, (2, n))
    bounds = np.stack([middle[0] - width[0], middle[0] + width[0], middle[1] - width[1], middle[1] + width[1]])
    path, turn_rate = rng.normal(0.0, 0.3, n), rng.normal(0.0, 0.05, n)
    before = Prediction(mpc.times, rng.normal(0.0, [0.5, 0.05, 0.02, 0.1, 0.03, 0.03], (n, 6)), np.zeros((n, 2)), 0.0)
    disturbance = tuple(rng.normal(0.0, 200.0, 2))
    return (
        x0,
        15.0,
        path,
        np.zeros(n),
        rng.uniform(0.03, 1.0, n),
        turn_rate,
        bounds,
        before,
        disturbance,
        (0.1, 0.1),
        CAR,
    )


def all_rows(mpc):
    """The QP with both bounds of every line as rows of their own."""
    lines, slopes, low, high = mpc.lines
    moves, count = slopes.shape[1], len(lines)
    rows = np.zeros((2 * count, moves + SLACKS))
    rows[:count, :moves], rows[count:, :moves] = slopes, -slopes
    soft = np.arange(mpc.soft[1])
    slack = np.where(soft < mpc.soft[0], moves, moves + 1)
    rows[soft, slack] = rows[soft + count, slack] = -SLACK_UNIT
    return rows, np.full(2 * count, -1e30), np.concatenate([high - lines, lines - low])


def exact(mpc):
    """The same problem by DAQP, an active-set method."""
    p = mpc.problem
    g, low, high = all_rows(mpc)
    a = np.ascontiguousarray(g)
    x, value, flag, _ = daqp.solve(
        np.ascontiguousarray(p.P), p.c.copy(), a, np.concatenate([np.minimum(p.x_u, 1e30), high]),
        np.concatenate([p.x_l, low]), np.zeros(len(p.c) + len(g), dtype=np.int32), primal_tol=1e-10,
    )  # fmt: skip
    assert flag == 1
    return x, value


@pytest.mark.parametrize("seed", range(12))
def test_first_move_is_the_exact_optimum(seed):
    mpc = make()
    solution = mpc.solve(*case(mpc, seed))
    assert solution.solved
    z, _ = exact(mpc)
    assert solution.z[0] == pytest.approx(z[0], abs=1e-5)


def multipliers(mpc, solution):
    """Of upper and lower bounds of rows and variables; where none acts only slacks have one, which is their cost."""
    p = mpc.problem
    if solution.status != UNCONSTRAINED:
        r = mpc._used._solver.result
        return r.z_u, r.z_l, r.z_bu, r.z_bl
    none = np.zeros(len(p.h_u))
    return none, none, np.zeros(len(p.c)), np.where(np.arange(len(p.c)) < len(p.c) - SLACKS, 0.0, p.c)


@pytest.mark.parametrize("seed", range(12))
def test_kkt_residuals(seed):
    mpc = make()
    solution = mpc.solve(*case(mpc, seed))
    z_u, z_l, z_bu, z_bl = multipliers(mpc, solution)
    p, z = mpc.problem, solution.z
    finite_u, finite_l = np.isfinite(p.h_u), np.isfinite(p.h_l)
    stationarity = p.P @ z + p.c + p.G.T @ (z_u - z_l) + z_bu - z_bl
    scale = max(1.0, np.abs(p.c).max())
    assert np.abs(stationarity).max() <= 1e-8 * scale
    value = p.G @ z
    assert np.maximum(value - p.h_u, p.h_l - value).max() <= 1e-8
    assert np.maximum(z - p.x_u, p.x_l - z).max() <= 1e-8
    assert min(z_u.min(), z_l.min(), z_bu.min(), z_bl.min()) >= 0.0
    complementarity = [
        z_u[finite_u] * (p.h_u - value)[finite_u], z_l[finite_l] * (value - p.h_l)[finite_l],
    ]  # fmt: skip
    assert max(np.abs(c).max(initial=0.0) for c in complementarity) <= 1e-7 * scale


@pytest.mark.parametrize("line", [1, 3])
def test_piqp_is_asked_where_a_bound_acts(line):
    mpc = make()
    x0, v, path, heading, firmness, turn_rate, bounds, *rest = case(mpc, 0)
    bounds[::2], bounds[1::2] = -9.0, 9.0
    free = mpc.solve(x0, v, path, heading, firmness, turn_rate, bounds, *rest)
    assert free.status == UNCONSTRAINED
    assert free.iterations == 0
    offset = free.states[1:, 0] + LIMITS.levers[line // 2] * free.states[1:, 1]
    node = len(offset) // 2
    bounds[line, node] = offset[node] + 1e-9
    assert np.array_equal(mpc.solve(x0, v, path, heading, firmness, turn_rate, bounds, *rest).z, free.z)
    bounds[line, node] = offset[node] - 1e-6
    bounded = mpc.solve(x0, v, path, heading, firmness, turn_rate, bounds, *rest)
    assert bounded.status == "PIQP_SOLVED"
    assert bounded.z == pytest.approx(free.z, abs=1e-4)  # 100 times the micrometre
    assert not np.array_equal(bounded.z, free.z)


@pytest.mark.parametrize("curvature", [0.0, -1.0, np.nan])
def test_what_is_not_convex_is_left_to_piqp(curvature):
    cost, z, none = np.diag([1.0, curvature, 1.0, 1.0]), np.zeros(4), np.zeros(0)
    assert not solve_freely(cost, z, 0.4, none, np.zeros((0, 2)), none, none, z.copy())
    cost[1, 1] = 1.0
    assert solve_freely(cost, z, 0.4, none, np.zeros((0, 2)), none, none, z.copy())


def test_prediction_is_the_simulated_model():
    mpc = make()
    x0, v, path, heading, firmness, turn_rate, *rest, car = case(mpc, 3)
    solution = mpc.solve(x0, v, path, heading, firmness, turn_rate, *rest, car)
    x, before = x0.copy(), 0.0
    for k, t in enumerate(mpc.times):
        slope_f, force_f, slope_r, force_r, _ = mpc.forces[mpc.group[k]]
        e = exponential(model_block(v, slope_f, slope_r, car), t - before)
        x = np.ascontiguousarray(e[:, :6]) @ x + e[:, RATE] * solution.z[mpc.block[k]]
        x += e[:, TURN] * turn_rate[k] + e[:, FRONT] * force_f + e[:, REAR] * force_r
        assert solution.states[k + 1] == pytest.approx(x, abs=1e-10)
        before = t


def cost(mpc, states, z, v, path, heading, firmness):
    """Cost (15) written out from the predicted states."""
    steps = np.diff(mpc.times, prepend=0.0) / 0.1
    terminal = np.where(np.arange(len(steps)) == len(steps) - 1, 3.0, 1.0)
    s = states[1:]
    slope_f, force_f, slope_r, force_r, _ = mpc.forces[mpc.group].T
    alpha_f = s[:, 4] - s[:, 2] - BMW.l_f * s[:, 3] / v
    alpha_r = -s[:, 2] + BMW.l_r * s[:, 3] / v
    a_y = (force_f + slope_f * alpha_f + force_r + slope_r * alpha_r) / BMW.mass
    w = WEIGHTS
    tracking = w.offset * (s[:, 0] - path) ** 2 + w.lateral_speed * (v * (s[:, 1] - heading)) ** 2
    stage = firmness * tracking + w.acceleration * a_y**2
    effort = (w.rate + w.jerk * steady_gain(v, CAR) ** 2) * z[mpc.block] ** 2
    slack = z[-2:] * SLACK_UNIT
    return 0.5 * (steps @ (terminal * stage + effort) + SLACK_CURVATURE * slack @ slack) + [w.corridor, w.slip] @ slack


def test_qp_cost_is_equation_15():
    mpc = make()
    arguments = case(mpc, 5)
    x0, v, path, heading, firmness, *_ = arguments
    solution = mpc.solve(*arguments)
    p, z = mpc.problem, solution.z
    free = np.vstack([x0, mpc._prediction[0]])
    reference = v, path, heading, firmness
    difference = cost(mpc, solution.states, z, *reference) - cost(mpc, free, 0 * z, *reference)
    assert 0.5 * z @ p.P @ z + p.c @ z == pytest.approx(difference, rel=1e-9)


def test_reserve_rows_make_the_reduced_problem_exact():
    """A bound on the side that has no row to begin with is found and kept."""
    mpc = make()
    x0, v, path, heading, firmness, turn_rate, bounds, *tyres = case(mpc, 1)
    n = len(mpc.times)
    path = np.where(np.arange(n) < 15, 3.0, -3.0)  # swings from one edge to the other
    bounds = np.stack([np.full(n, -0.4), np.full(n, 0.4)] * 2)
    for _ in range(3):  # the rows to begin with come from the last solution
        solution = mpc.solve(0 * x0, v, path, heading, firmness, turn_rate, bounds, *tyres)
        z, value = exact(mpc)
        assert 0.5 * solution.z @ mpc.problem.P @ solution.z + mpc.problem.c @ solution.z == pytest.approx(
            value, rel=1e-6
        )
        assert solution.z[0] == pytest.approx(z[0], abs=1e-5)


def test_contradicting_bounds_give_slack_not_failure():
    mpc = make()
    _, v, path, heading, firmness, turn_rate, bounds, *tyres = case(mpc, 2)
    bounds[:] = 0.0
    start = np.array([2.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    solution = mpc.solve(start, v, path, heading, firmness, turn_rate, bounds, *tyres)
    assert solution.solved
    assert solution.slack_corridor > 1.0


def test_hard_limits_hold():
    mpc = make()
    _, *arguments = case(mpc, 4)
    solution = mpc.solve(np.array([3.0, 0.5, 0.1, 0.4, 0.2, 0.2]), *arguments)
    assert np.abs(solution.z[:-2]).max() <= BMW.steer_rate_limit + 1e-9
    assert np.abs(solution.states[:, 5]).max() <= BMW.steer_limit + 1e-9


def test_no_row_is_unbounded_on_both_sides():
    mpc = make()
    mpc.solve(*case(mpc, 0))
    assert np.all(np.isfinite(mpc.problem.h_l) | np.isfinite(mpc.problem.h_u))


def test_piqp_drops_a_row_that_was_unbounded_once():
    """Why the test above matters: a later finite bound on such a row is ignored without a word."""
    solver = piqp.DenseSolver()
    g = np.asfortranarray([[1.0, 1.0]])
    inf = np.full(1, np.inf)
    solver.setup(np.asfortranarray(np.eye(2)), np.full(2, -2.0), None, None, g, -inf, inf, None, None)
    solver.solve()
    solver.update(h_l=-inf, h_u=np.ones(1))
    assert solver.solve() == piqp.PIQP_SOLVED
    assert np.array(solver.result.x).sum() > 1.5


def test_solution_does_not_change_with_the_next_solve():
    mpc = make()
    first = mpc.solve(*case(mpc, 0))
    kept = first.z.copy()
    mpc.solve(*case(mpc, 1))
    assert np.array_equal(first.z, kept)


@pytest.mark.closed_loop
def test_closed_loop_problems_against_the_exact_solver():
    """u0 of every step of the double obstacle within 1e-5 of DAQP on all rows."""
    road = ReferencePath.from_segments([Line(150.0)])
    controller = SteeringController(BMW, road, DOUBLE, ControllerConfig())
    worst = 0.0
    with LinearPlant(BMW) as plant:
        state = plant.reset(VehicleState(v_x=15.0))
        for _ in range(300):
            command = controller.step(state)
            z, _ = exact(controller._mpc)
            applied = (controller.plan.states[1, 5] - controller.plan.states[0, 5]) / 0.02
            worst = max(worst, abs(z[0] - applied))
            state = plant.step(command, 0.02)
    assert worst <= 1e-5
