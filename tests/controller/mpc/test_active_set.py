"""The active set: optimality conditions, other solvers, real drives, and problems that are hard or wrong."""

from typing import NamedTuple

import daqp
import numba
import numba.core.errors
import numpy as np
import piqp
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.controller.mpc.active_set.iteration import EXHAUSTED, INFEASIBLE, INVALID, SOLVED, solve
from sidestep.controller.mpc.active_set.solver import size
from sidestep.controller.mpc.piqp_solver import set_up
from sidestep.controller.mpc.stack import SLACK_CURVATURE
from sidestep.controller.records import ACTIVE_SET, SLACKS, WORK, record
from sidestep.plant_models.kernels import bare_kernel
from sidestep.validation.studies.recorded_problems import Recorded, recorded

LIMIT = 300
KKT, FIRST_MOVE = 1e-9, 1e-8
PIQP_ERROR = 1e-5
"""Of its first move, as in `test_mpc`, in [rad/s]."""
FAR = 1e30
"""What DAQP takes for no bound."""


class Problem(NamedTuple):
    """One QP with n moves: cost H, g; lines G from lower to upper; slacks that soften lines before `ends`."""

    H: np.ndarray
    g: np.ndarray
    G: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    x_lower: np.ndarray
    x_upper: np.ndarray
    price: np.ndarray
    curvature: np.ndarray
    ends: np.ndarray


class Result:
    """Where a solve ended, and where the next one may begin."""

    def __init__(self):
        self.work, self.set = record(WORK), record(ACTIVE_SET)
        self.x, self.active, self.multipliers = np.zeros(0), self.set["active"][0], np.zeros(0)

    @property
    def count(self) -> int:
        return int(self.set["count"][0])

    def begin(self, active) -> "Result":
        self.active[: len(active)], self.set["count"] = active, len(active)
        return self

    def solve(self, p: Problem, limit: int) -> tuple[int, int]:
        w = self.work[0]
        a, n, lines = w["active"], len(p.g), len(p.lower)
        w["P"][:n, :n], w["q"][:n], w["slopes"][:lines, :n] = p.H, p.g, p.G
        w["lines"][:lines], w["low"][:lines], w["high"][:lines], w["count"] = 0.0, p.lower, p.upper, lines
        a["x_lower"][:n], a["x_upper"][:n] = p.x_lower, p.x_upper
        for name, values in (("price", p.price), ("curvature", p.curvature), ("ends", p.ends)):
            a[name][: len(values)] = values
        size(a, n, len(p.price))
        status, iterations = solve(w, self.set[0], limit, a)
        self.x, self.multipliers = a["x"][: n + len(p.price)].copy(), a["multipliers"].copy()
        return status, iterations


class Written(NamedTuple):
    """A problem with a row for each bound: min 1/2 x'Hx + g'x with normals x >= bounds."""

    H: np.ndarray
    g: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def written_out(p: Problem) -> Written:
    """Cost of all variables, and normals of the lower and of the upper bounds: lines, then variables."""
    n, k, lines = len(p.g), len(p.price), len(p.lower)
    cost = np.zeros((n + k, n + k))
    cost[:n, :n], cost[n:, n:] = p.H, np.diag(p.curvature)
    above = np.vstack([np.hstack([p.G, np.zeros((lines, k))]), np.eye(n + k)])
    below, begin = -above, 0
    for s, end in enumerate(p.ends):
        above[begin:end, n + s] = below[begin:end, n + s] = 1.0
        begin = max(begin, end)
    return Written(cost, np.concatenate([p.g, p.price]), above, below)


def bounds(p: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Of normals x >= bound: of the lower and of the upper bounds."""
    k = len(p.price)
    lower, upper = (p.lower, p.x_lower, np.zeros(k)), (p.upper, p.x_upper, np.full(k, np.inf))
    return np.concatenate(lower), -np.concatenate(upper)


def run(p: Problem, result: Result | None = None, limit: int = LIMIT) -> tuple[int, int, Result]:
    """Solve, from what an earlier result says if there is one."""
    result = result or Result()
    return (*result.solve(p, limit), result)


def residuals(p: Problem, result: Result) -> tuple[float, float, float, float]:
    """Stationarity, violation, complementarity, and the size of the largest force in the balance, at least 1."""
    w, (low, high), x = written_out(p), bounds(p), result.x
    balance, complementarity = w.H @ x + w.g, 0.0
    force = max(1.0, float(np.abs(balance).max()))
    active = result.active[: result.count]
    assert len(set(active)) == len(active)
    for code, multiplier in zip(active, result.multipliers, strict=False):
        normal, bound = (w.lower[~code], low[~code]) if code < 0 else (w.upper[code], high[code])
        assert multiplier >= 0.0
        balance -= multiplier * normal
        force = max(force, float(np.abs(multiplier * normal).max()))
        complementarity = max(complementarity, float(abs(multiplier * (normal @ x - bound))))
    violation = max((low - w.lower @ x).max(), (high - w.upper @ x).max())
    return float(np.abs(balance).max()), float(violation), complementarity, force


def by_daqp(p: Problem) -> tuple[np.ndarray, int]:
    """Optimum by another exact solver, and its verdict: 1 if it is one, -1 if there is none."""
    w, (low, high), n = written_out(p), bounds(p), len(p.g) + len(p.price)
    lines = len(p.lower)
    rows = np.vstack([w.lower[:lines], w.upper[:lines]])
    least = np.maximum(np.concatenate([low[:lines], high[:lines]]), -FAR)
    lower, upper = np.concatenate([low[lines:], least]), np.concatenate([-high[lines:], np.full(2 * lines, FAR)])
    x, _, flag, _ = daqp.solve(
        w.H, w.g, np.ascontiguousarray(rows), np.clip(upper, -FAR, FAR), np.clip(lower, -FAR, FAR),
        np.zeros(n + 2 * lines, dtype=np.int32), primal_tol=1e-11,
    )  # fmt: skip
    return x, flag


def random_problem(seed: int, moves: int, slacks: int, lines: int, feasible: bool = True) -> Problem:
    """Half of the lines one-sided; without slacks feasible where wanted."""
    rng = np.random.default_rng(seed)
    root, slopes = rng.normal(size=(moves, moves)), rng.normal(size=(lines, moves))
    middle = slopes @ rng.uniform(-1.0, 1.0, moves) + (0.0 if feasible else rng.normal(0.0, 2.0, lines))
    lower, upper = middle - rng.uniform(0.0, 1.0, lines), middle + rng.uniform(0.0, 1.0, lines)
    lower[rng.random(lines) < 0.25], upper[rng.random(lines) < 0.25] = -np.inf, np.inf
    return Problem(
        root @ root.T + 0.1 * np.eye(moves), 10.0 * rng.normal(size=moves), slopes, lower, upper,
        np.full(moves, -2.0), np.full(moves, 2.0), rng.uniform(1.0, 30.0, slacks), rng.uniform(0.1, 10.0, slacks),
        np.sort(rng.integers(0, lines + 1, slacks)),
    )  # fmt: skip


def hard(slopes, lower, upper) -> Problem:
    """Nearest to (3, 0, ..., 0), hard lines only."""
    slopes = np.array(slopes, dtype=np.float64)
    n = slopes.shape[1]
    wide, none = np.full(n, 1e6), np.zeros(0)
    return Problem(
        np.eye(n), np.concatenate([[-3.0], np.zeros(n - 1)]), slopes, np.array(lower, dtype=np.float64),
        np.array(upper, dtype=np.float64), -wide, wide, none, none, np.zeros(0, dtype=np.int64),
    )  # fmt: skip


def assert_optimal(p: Problem, result: Result, relative: bool = False) -> None:
    stationarity, violation, complementarity, force = residuals(p, result)
    scale = force if relative else 1.0
    assert stationarity <= KKT * scale
    assert violation <= KKT
    assert complementarity <= KKT * scale


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


@pytest.mark.parametrize("copies", [2, 5, 40])
def test_degenerate_one_line_many_times(copies):
    p = hard([[1.0, 1.0, 0.0]] * copies, [-9.0] * copies, [1.0] * copies)
    status, _, result = run(p)
    assert status == SOLVED
    assert_optimal(p, result)
    assert result.count == 1


def test_degenerate_many_lines_through_one_vertex():
    angles = np.linspace(0.0, np.pi / 2.0, 31)
    p = hard(np.column_stack([np.cos(angles), np.sin(angles)]), [-9.0] * 31, [0.0] * 31)
    status, _, result = run(p)
    assert status == SOLVED
    assert_optimal(p, result)
    assert result.x == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_line_that_depends_on_the_active_ones_replaces_one():
    p = hard([[1.0, 1.0], [1.0, -1.0], [1.0, 0.0]], [-9.0, -9.0, -9.0], [0.5, 0.7, 0.1])
    status, _, result = run(p, Result().begin([0, 1]))
    assert status == SOLVED
    assert result.x == pytest.approx([0.1, 0.0], abs=1e-12)
    assert list(result.active[: result.count]) == [2]


def test_an_equality_is_two_bounds_that_meet():
    p = hard([[1.0, 1.0], [1.0, -1.0]], [0.5, 0.25], [0.5, 0.25])
    status, _, result = run(p)
    assert status == SOLVED
    assert result.x == pytest.approx([0.375, 0.125], abs=1e-12)


@pytest.mark.parametrize(("lower", "status"), [(-1.0, SOLVED), (0.0, SOLVED), (1e-3, INFEASIBLE)])
def test_a_line_without_slope(lower, status):
    assert run(hard([[0.0, 0.0]], [lower], [1.0]))[0] == status


@pytest.mark.parametrize(("gap", "status"), [(1e-6, SOLVED), (0.0, SOLVED), (-1e-12, SOLVED), (-1e-6, INFEASIBLE)])
def test_nearly_infeasible(gap, status):
    found, iterations, _ = run(hard([[1.0, 2.0], [1.0, 2.0]], [-9.0, 1.0], [1.0 + gap, 9.0]))
    assert found == status
    assert iterations <= 4


def test_soft_lines_may_contradict_each_other():
    p = hard([[1.0, 0.0], [1.0, 0.0]], [2.0, -9.0], [9.0, -2.0])
    soft = p._replace(price=np.array([300.0]), curvature=np.array([1e3]), ends=np.array([2]))
    status, _, result = run(soft)
    assert status == SOLVED
    assert_optimal(soft, result)
    assert result.x == pytest.approx([0.0, 0.0, 2.0], abs=2e-3)
    crossing = soft._replace(G=p.G[:1], lower=p.lower[:1], upper=p.upper[1:], ends=np.array([1]))
    status, _, again = run(crossing)  # the same, as two bounds of one line
    assert status == SOLVED
    assert again.x == pytest.approx(result.x, abs=1e-12)


def test_cost_of_deficient_rank_is_refused():
    p = hard([[1.0, 0.0]], [-1.0], [1.0])
    root = np.array([[1.0, 2.0]])
    for cost in (root.T @ root, np.zeros((2, 2)), -np.eye(2)):
        assert run(p._replace(H=cost))[0] == INVALID


@pytest.mark.parametrize("field", [f for f in Problem._fields if f != "ends"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_refused(field, wrong):
    p = random_problem(3, 4, 2, 9)
    p = p._replace(lower=np.maximum(p.lower, -9.0), upper=np.minimum(p.upper, 9.0))
    none = {"lower": -np.inf, "x_lower": -np.inf, "upper": np.inf, "x_upper": np.inf}
    for place in np.ndindex(getattr(p, field).shape):
        values = getattr(p, field).copy()
        values[place] = wrong
        with np.errstate(all="ignore"):
            status, _, _ = run(p._replace(**{field: values}))
        assert status == (SOLVED if none.get(field) == wrong else INVALID), place


def test_bounds_of_moves_that_cross_are_refused():
    p = random_problem(3, 4, 2, 9)
    assert run(p._replace(x_lower=p.x_upper, x_upper=p.x_lower))[0] == INVALID


def test_it_stops_at_its_limit():
    p = random_problem(1, 15, 2, 40)
    _, needed, _ = run(p)
    assert needed > 3
    for limit in range(needed):
        status, iterations, _ = run(p, limit=limit)
        assert (status, iterations) == (EXHAUSTED, limit)
    assert run(p, limit=needed)[0] == SOLVED


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
