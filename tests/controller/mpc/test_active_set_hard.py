"""The active set on problems that are hard or wrong: degenerate, contradictory, of deficient rank, not finite."""

import numpy as np
import pytest
from support.active_set_case import Problem, Result, assert_optimal, hard, random_problem, run

from sidestep.controller.mpc.active_set.iteration import EXHAUSTED, INFEASIBLE, INVALID, SOLVED


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
