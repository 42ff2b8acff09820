"""The active set: optimality conditions, other solvers, and real drives."""

import numba
import numba.core.errors
import numpy as np
import piqp
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.active_set_case import FIRST_MOVE, Problem, Result, assert_optimal, by_daqp, random_problem, run

from sidestep.controller.mpc.active_set.iteration import INFEASIBLE, SOLVED
from sidestep.controller.mpc.piqp_solver import set_up
from sidestep.controller.mpc.stack import SLACK_CURVATURE
from sidestep.controller.records import SLACKS
from sidestep.plant_models.kernels import bare_kernel
from sidestep.validation.studies.recorded_problems import Recorded, recorded

PIQP_ERROR = 1e-5
"""Of its first move, as in `test_mpc`, in [rad/s]."""
SIZES = (st.integers(0, 10**6), st.integers(1, 15), st.integers(0, SLACKS), st.integers(0, 40))


@settings(deadline=None, max_examples=150)
@given(*SIZES)
def test_any_problem_is_solved_cold_and_warm(seed, moves, slacks, lines):
    p = random_problem(seed, moves, slacks, lines)
    status, _, cold = run(p)
    assert status == SOLVED
    assert_optimal(p, cold)
    assert cold.x == pytest.approx(by_daqp(p)[0], abs=1e-7)
    x = cold.x.copy()
    status, iterations, again = run(p, cold)
    assert (status, iterations) == (SOLVED, 0)  # from its own active bounds there is nothing left to do
    assert again.x == pytest.approx(x, abs=1e-9)


@settings(deadline=None, max_examples=150)
@given(*SIZES)
def test_where_it_begins_does_not_matter(seed, moves, slacks, lines):
    p, other = random_problem(seed, moves, slacks, lines), random_problem(seed + 1, moves, slacks, lines)
    _, _, begin = run(other)
    status, _, warm = run(p, begin)
    assert status == SOLVED
    assert_optimal(p, warm)
    assert warm.x == pytest.approx(run(p)[2].x, abs=1e-9)


@settings(deadline=None, max_examples=150)
@given(*SIZES, st.integers(0, 10**6))
def test_a_beginning_that_is_noise_does_no_harm(seed, moves, slacks, lines, noise):
    p, rng = random_problem(seed, moves, slacks, lines), np.random.default_rng(noise)
    begin = Result().begin(rng.integers(-lines - moves - 9, lines + moves + 9, moves + slacks))
    begin.set["count"] = rng.integers(0, 2**40)
    status, _, result = run(p, begin)
    assert status == SOLVED
    assert_optimal(p, result)


@settings(deadline=None, max_examples=150)
@given(*SIZES)
def test_contradictions_are_found_where_daqp_finds_them(seed, moves, slacks, lines):
    p = random_problem(seed, moves, slacks, lines, feasible=False)
    status, _, result = run(p)
    x, flag = by_daqp(p)
    assert (status, flag) in ((SOLVED, 1), (INFEASIBLE, -1))
    if status == SOLVED:
        assert_optimal(p, result)
        assert result.x == pytest.approx(x, abs=1e-7)


def test_lines_without_a_bound_change_nothing():
    p = random_problem(5, 8, 2, 30)
    some = np.arange(30) % 3 == 0
    lower, upper = np.where(some, -1e4, p.lower), np.where(some, 1e4, p.upper)
    status, _, result = run(p._replace(lower=lower, upper=upper))
    rest = p._replace(
        G=p.G[~some], lower=p.lower[~some], upper=p.upper[~some], ends=np.array([(~some[:e]).sum() for e in p.ends])
    )
    assert status == SOLVED
    assert np.array_equal(result.x, run(rest)[2].x)


def test_memory_of_another_problem_leaves_no_trace():
    p, result = random_problem(5, 8, 2, 30), Result()
    run(p, result)
    first, active = result.x, result.active[: result.count].copy()
    space = result.work["active"]
    for name in space.dtype.names:
        space[name] = np.nan if space.dtype[name].base == np.float64 else 10**6
    result.set["count"] = 0
    run(p, result)
    assert np.array_equal(result.x, first)
    assert np.array_equal(result.active[: result.count], active)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_a_kernel_that_allocates_does_not_compile():
    with pytest.raises(numba.core.errors.NumbaError):
        bare_kernel(lambda n: np.zeros(n)[0])(3)
    assert bare_kernel(lambda values: values[1:][0] / 0.0)(np.ones(3)) == np.inf  # slices and zeros are fine


@pytest.fixture(scope="module")
def steps() -> list[Recorded]:
    return recorded()


def lines_of(step: Recorded) -> Problem:
    """A recorded step's QP, slacks in metres and radians."""
    w, c = step.work[0], step.settings[0]
    n, count, grid = int(c["grid"]["moves"]), int(w["count"]), c["grid"]
    values, rate = w["lines"][:count], np.full(n, c["car"]["rate_limit"])
    corridor = 2 * (grid["nodes"] - grid["first"])
    return Problem(
        w["P"][:n, :n], w["q"][:n], w["slopes"][:count, :n], w["low"][:count] - values, w["high"][:count] - values,
        -rate, rate, np.array([c["weights"]["corridor"], c["weights"]["slip"]]), np.full(2, SLACK_CURVATURE),
        np.array([corridor, corridor + 2 * grid["slips"]]),
    )  # fmt: skip


@pytest.mark.closed_loop
def test_real_drives(steps):
    """Optimality, DAQP's and PIQP's first move, and a warm start along each drive."""
    scene, warm = "", None
    for step in steps:
        p = lines_of(step)
        status, iterations, cold = run(p)
        status_warm, _, warm = run(p, warm if step.scene == scene else None)
        scene = step.scene
        assert status == status_warm == SOLVED
        assert (iterations > 0) == step.bounded
        assert_optimal(p, cold, scene == "hostile")  # whose forces are larger by orders
        assert_optimal(p, warm, scene == "hostile")
        x, flag = by_daqp(p)
        assert flag == 1
        assert cold.x[0] == pytest.approx(x[0], abs=FIRST_MOVE)
        assert warm.x[0] == pytest.approx(x[0], abs=FIRST_MOVE)


@pytest.mark.closed_loop
def test_real_drives_beside_piqp(steps):
    """PIQP on the rows that the controller gave it: nearly always as accurate as it was asked to be.

    Where it ends farther away, with a small residual all the same, DAQP says who is right.
    """
    solved = far = 0
    for step in (step for step in steps if step.bounded):
        solver = set_up(step.rows)
        if solver.solve() == piqp.PIQP_SOLVED:
            solved += 1
            error = PIQP_ERROR * (10.0 if step.scene == "hostile" else 1.0)  # of the costs' scale
            ours = run(lines_of(step))[2].x[0]
            if abs(ours - solver.result.x[0]) > error:
                far += 1
                assert ours == pytest.approx(by_daqp(lines_of(step))[0][0], abs=FIRST_MOVE)
                assert ours == pytest.approx(solver.result.x[0], abs=1e-3)
    assert solved > 900
    assert far <= 2
