"""Problems for the active set, its optimality conditions, and DAQP beside it."""

from typing import NamedTuple

import daqp
import numpy as np

from sidestep.controller.mpc.active_set.iteration import solve
from sidestep.controller.mpc.active_set.solver import size
from sidestep.controller.records import ACTIVE_SET, WORK, record

LIMIT = 300
KKT, FIRST_MOVE = 1e-9, 1e-8
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
