"""The QP and its solution: KKT conditions, an exact solver, finite differences, PIQP's traps."""

import daqp
import numpy as np
import piqp
import pytest
from support.qp_case import BMW, CONFIG, Qp

from sidestep.controller import SteeringController
from sidestep.controller.mpc.discretise import exponential
from sidestep.controller.mpc.prediction import FRONT, RATE, REAR, TURN, model_block, steady_gain
from sidestep.controller.mpc.stack import SLACK_CURVATURE, SLACK_UNIT, stack_costs
from sidestep.controller.mpc.unconstrained import solve_freely
from sidestep.controller.records import SLACKS
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Line
from sidestep.plant_models.signals import VehicleState

DOUBLE = (Obstacle(40.0, -0.6, 4.5, 1.8), Obstacle(70.0, 0.8, 4.5, 1.8))


def exact(qp):
    """The same problem by DAQP, an active-set method."""
    (P, q), (g, high) = qp.cost, qp.all_rows()
    rate, moves = qp.c["car"]["rate_limit"], qp.moves
    upper = np.concatenate([np.full(moves, rate), np.full(SLACKS, 1e30)])
    lower = np.concatenate([np.full(moves, -rate), np.zeros(SLACKS)])
    x, value, flag, _ = daqp.solve(
        np.ascontiguousarray(P), q, np.ascontiguousarray(g), np.concatenate([upper, high]),
        np.concatenate([lower, np.full(len(g), -1e30)]), np.zeros(len(q) + len(g), dtype=np.int32), primal_tol=1e-10,
    )  # fmt: skip
    assert flag == 1
    return x, value


@pytest.mark.parametrize("seed", range(12))
def test_first_move_is_the_exact_optimum(seed):
    qp = Qp(seed)
    qp.solve()
    assert qp.z[0] == pytest.approx(exact(qp)[0][0], abs=1e-5)


@pytest.mark.parametrize("seed", range(12))
def test_kkt_residuals(seed):
    qp = Qp(seed)
    if not qp.solve():
        P, q = qp.cost  # only slacks have multipliers, which are their cost
        assert np.abs(P @ qp.z + q)[: qp.moves].max() <= 1e-8 * max(1.0, np.abs(q).max())
        return
    p, z, r = qp.solver.problem, qp.z, qp.solver._used.solver.result
    scale, value = max(1.0, np.abs(p.c).max()), p.G @ z
    finite_u, finite_l = np.isfinite(p.h_u), np.isfinite(p.h_l)
    stationarity = p.P @ z + p.c + p.G.T @ (r.z_u - r.z_l) + r.z_bu - r.z_bl
    assert np.abs(stationarity).max() <= 1e-8 * scale
    assert np.maximum(value - p.h_u, p.h_l - value).max() <= 1e-8
    assert np.maximum(z - p.x_u, p.x_l - z).max() <= 1e-8
    assert min(r.z_u.min(), r.z_l.min(), r.z_bu.min(), r.z_bl.min()) >= 0.0
    complementarity = [r.z_u[finite_u] * (p.h_u - value)[finite_u], r.z_l[finite_l] * (value - p.h_l)[finite_l]]
    assert max(np.abs(c).max(initial=0.0) for c in complementarity) <= 1e-7 * scale


@pytest.mark.parametrize("line", [1, 3])
def test_the_solver_is_asked_where_a_bound_acts(line):
    qp = Qp(0)
    bounds = qp.w["bounds"]
    bounds[::2], bounds[1::2] = -9.0, 9.0
    assert not qp.solve()
    free = qp.z
    offset = qp.states[:, 0] + qp.grid["levers"][line // 2] * qp.states[:, 1]
    node = len(offset) // 2
    bounds[line, node] = offset[node] + 1e-9
    assert not qp.solve()
    assert np.array_equal(qp.z, free)
    bounds[line, node] = offset[node] - 1e-6
    assert qp.solve()
    assert qp.z == pytest.approx(free, abs=1e-4)  # 100 times the micrometre
    assert not np.array_equal(qp.z, free)


@pytest.mark.parametrize("curvature", [-1.0, 0.0, np.nan])
def test_what_is_not_convex_is_left_to_a_solver(curvature):
    qp = Qp(0)
    qp.w["bounds"][::2], qp.w["bounds"][1::2] = -99.0, 99.0
    assert not qp.solve()
    qp.w["P"][1, 1] = curvature
    assert not solve_freely(qp.w, qp.c)


def test_prediction_is_the_simulated_model():
    qp = Qp(3)
    qp.solve()
    w, before, x = qp.w, 0.0, qp.w["x0"].copy()
    generator, e = np.empty((6, 10)), np.empty((6, 10))
    for k, t in enumerate(qp.times):
        slope_f, force_f, slope_r, force_r, _ = w["forces"][qp.grid["group"][k]]
        model_block(15.0, slope_f, slope_r, qp.c["car"], generator)
        exponential(generator, t - before, e, np.empty((4, 6, 10)))
        x = np.ascontiguousarray(e[:, :6]) @ x + e[:, RATE] * qp.z[qp.grid["block"][k]]
        x += e[:, TURN] * w["turn_rate"][k] + e[:, FRONT] * force_f + e[:, REAR] * force_r
        assert qp.states[k] == pytest.approx(x, abs=1e-10)
        before = t


def cost(qp, states, z):
    """Cost (15) written out from the predicted states."""
    n, w, c = qp.nodes, qp.w, qp.c["weights"]
    steps = np.diff(qp.times, prepend=0.0) / 0.1
    terminal = np.where(np.arange(n) == n - 1, 3.0, 1.0)
    slope_f, force_f, slope_r, force_r, _ = w["forces"][qp.grid["group"][:n]].T
    alpha_f = states[:, 4] - states[:, 2] - BMW.l_f * states[:, 3] / 15.0
    alpha_r = -states[:, 2] + BMW.l_r * states[:, 3] / 15.0
    a_y = (force_f + slope_f * alpha_f + force_r + slope_r * alpha_r) / BMW.mass
    tracking = c["offset"] * (states[:, 0] - w["path"][:n]) ** 2
    tracking += c["lateral_speed"] * (15.0 * (states[:, 1] - w["heading"][:n])) ** 2
    stage = w["tracking_share"][:n] * tracking + c["acceleration"] * a_y**2
    effort = (c["rate"] + c["jerk"] * steady_gain(15.0, qp.c["car"]) ** 2) * z[qp.grid["block"][:n]] ** 2
    slack = z[-2:] * SLACK_UNIT
    return 0.5 * (steps @ (terminal * stage + effort) + SLACK_CURVATURE * slack @ slack) + slack @ [
        c["corridor"], c["slip"],
    ]  # fmt: skip


def test_qp_cost_is_equation_15():
    qp = Qp(5)
    qp.w["heading"][: qp.nodes] = np.linspace(0.0, 0.1, qp.nodes)
    qp.solve()
    (P, q), z = qp.cost, qp.z
    difference = cost(qp, qp.states, z) - cost(qp, qp.w["free"][: qp.nodes], 0 * z)
    assert 0.5 * z @ P @ z + q @ z == pytest.approx(difference, rel=1e-9)


def test_each_node_counts_at_its_own_speed():
    """What the states cost and how they follow, with a speed that falls along the horizon."""
    qp = Qp(6)
    n = qp.nodes
    speed = qp.w["speed"][:n] = np.linspace(20.0, 5.0, n)
    qp.stack()
    w, x, slope, before = qp.w, qp.w["x0"].copy(), np.zeros((6, qp.moves)), 0.0
    generator, e = np.empty((6, 10)), np.empty((6, 10))
    for k, t in enumerate(qp.times):
        slope_f, force_f, slope_r, force_r, _ = w["forces"][qp.grid["group"][k]]
        model_block(speed[k], slope_f, slope_r, qp.c["car"], generator)
        exponential(generator, t - before, e, np.empty((4, 6, 10)))
        x = e[:, :6] @ x + e[:, TURN] * w["turn_rate"][k] + e[:, FRONT] * force_f + e[:, REAR] * force_r
        slope = e[:, :6] @ slope
        slope[:, qp.grid["block"][k]] += e[:, RATE]
        assert w["free"][k] == pytest.approx(x, abs=1e-9)
        assert w["response"][k, :, : qp.moves] == pytest.approx(slope, abs=1e-9)
        before = t
    heading = w["response"][:n, 1, : qp.moves]
    without = w["P"].copy()
    qp.c["weights"]["lateral_speed"] += 1.0
    stack_costs(qp.w, qp.c)
    share = np.diff(qp.times, prepend=0.0) / 0.1 * w["tracking_share"][:n] * speed**2
    share[-1] *= 3.0
    assert (w["P"] - without)[: qp.moves, : qp.moves] == pytest.approx(heading.T @ (share[:, None] * heading), abs=1e-6)


def test_reserve_rows_make_the_reduced_problem_exact():
    """A bound on the side that has no row to begin with is found and kept."""
    qp = Qp(1)
    n = qp.nodes
    qp.w["path"][:n] = np.where(np.arange(n) < 15, 3.0, -3.0)  # swings from one edge to the other
    qp.w["bounds"][::2], qp.w["bounds"][1::2], qp.w["x0"][:] = -0.4, 0.4, 0.0
    for _ in range(3):  # the rows to begin with come from the last solution
        assert qp.solve()
        (P, q), (z, value) = qp.cost, exact(qp)
        assert 0.5 * qp.z @ P @ qp.z + q @ qp.z == pytest.approx(value, rel=1e-6)
        assert qp.z[0] == pytest.approx(z[0], abs=1e-5)


def test_contradicting_bounds_give_slack_not_failure():
    qp = Qp(2)
    qp.w["bounds"][:], qp.w["x0"][:] = 0.0, [2.0, 0.3, 0.0, 0.0, 0.0, 0.0]
    assert qp.solve()
    assert qp.z[qp.moves] * SLACK_UNIT > 1.0


def test_hard_limits_hold():
    qp = Qp(4)
    qp.w["x0"][:] = [3.0, 0.5, 0.1, 0.4, 0.2, 0.2]
    assert qp.solve()
    assert np.abs(qp.z[: qp.moves]).max() <= BMW.steer_rate_limit + 1e-9
    assert np.abs(qp.states[:, 5]).max() <= BMW.steer_limit + 1e-9


def test_no_row_is_unbounded_on_both_sides():
    qp = Qp(0)
    qp.stack()
    p = qp.solver.choose_rows(qp.work, qp.last)
    assert np.all(np.isfinite(p.h_l) | np.isfinite(p.h_u))


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


@pytest.mark.closed_loop
def test_closed_loop_problems_against_the_exact_solver():
    """u0 of every step of the double obstacle within 1e-5 of DAQP on all rows."""
    road, qp = ReferencePath.from_segments([Line(150.0)]), Qp(0)
    controller, worst = SteeringController(BMW, road, DOUBLE, CONFIG), 0.0
    qp.work, qp.w, qp.settings, qp.c = (
        controller.work,
        controller.work[0],
        controller.settings,
        controller.settings[0],
    )
    with LinearPlant(BMW) as plant:
        state = plant.reset(VehicleState(v_x=15.0))
        for _ in range(300):
            command = controller.step(state)
            plan = controller.plan
            applied = (plan.states[1, 5] - plan.states[0, 5]) / 0.02
            worst = max(worst, abs(exact(qp)[0][0] - applied))
            state = plant.step(command, 0.02)
    assert worst <= 1e-5
