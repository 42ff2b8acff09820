"""The active set beside PIQP and DAQP, on the QPs of real drives in which a bound acts.

    python benchmarks/active_set.py [passes]

In turns, in one process, one thread. PIQP is timed as the controller calls it: choose the rows, update, solve, add
what is violated, again until nothing is. The active set is timed as the compiled step will call it, by a clock read
between the solves in compiled code. It takes all lines, cold (without a beginning) and warm (from the active bounds
of the step before in its drive). DAQP gets all lines as one-sided rows, in Python. Every solve's time is the least
of all passes, which takes out what other programs on the machine do to it.
"""

import ctypes
import sys
from time import perf_counter_ns

import numpy as np
from numba import njit

from sidestep.controller.mpc import active_set
from sidestep.controller.mpc.active_set import Problem, Result, result_space, work_space
from sidestep.controller.mpc.mpc import Mpc
from sidestep.controller.mpc.qp import SLACK_UNIT, SLACKS
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.recorded_problems import Recorded, recorded

PASSES = 7
LIMIT = 200
_clock = ctypes.CDLL(None).clock_gettime
_clock.argtypes, _clock.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_int


@njit
def replay(problems, begins, warm, results, work, microseconds, iterations):
    """Solve problems in turn; each warm solve starts from the step before unless a drive begins."""
    now = np.zeros(4, dtype=np.int64)
    address = now.ctypes.data
    for i in range(begins.shape[0]):
        p = Problem(problems.H[i], problems.g[i], problems.G[i], problems.lower[i], problems.upper[i],
                    problems.x_lower[i], problems.x_upper[i], problems.price[i], problems.curvature[i],
                    problems.ends[i])  # fmt: skip
        result = Result(results.x[i], results.active[i], results.multipliers[i], results.size[i])
        result.size[0] = 0
        if warm and not begins[i]:
            result.size[0] = results.size[i - 1, 0]
            result.active[:] = results.active[i - 1]
        _clock(1, address)
        start = now[0] * 1000000000 + now[1]
        _, iterations[i] = active_set.solve(p, result, LIMIT, work)
        _clock(1, address)
        microseconds[i] = (now[0] * 1000000000 + now[1] - start) / 1000.0


class Replay:
    """All recorded problems for the active set, stacked."""

    def __init__(self, steps: list[Recorded], warm: bool):
        count = len(steps)
        self.problems = Problem(
            *(np.ascontiguousarray(np.stack(part)) for part in zip(*(s.lines for s in steps), strict=True))
        )
        first = steps[0].lines
        sizes = len(first.g), len(first.price)
        self.work = work_space(*sizes, len(first.lower))
        self.results = Result._make([np.stack([part] * count) for part in result_space(*sizes)])
        self.begins = np.array([i == 0 or steps[i - 1].scene != s.scene for i, s in enumerate(steps)])
        self.warm = warm
        self.iterations = np.zeros(count, dtype=np.int64)

    def __call__(self) -> np.ndarray:
        times = np.empty(len(self.begins))
        replay(self.problems, self.begins, self.warm, self.results, self.work, times, self.iterations)
        return times


class Piqp:
    """PIQP as the controller uses it."""

    def __init__(self, steps: list[Recorded]):
        scenario = load_scenario("moose")
        self.steps, self.mpc = steps, Mpc.of(scenario.vehicle, scenario.controller)

    def __call__(self) -> np.ndarray:
        times, mpc = np.empty(len(self.steps)), self.mpc
        for i, step in enumerate(self.steps):
            p, lines = step.rows, step.lines
            for into, of in zip(mpc._reduced.cost, (p.P, p.c), strict=True):
                into[:] = of
            for into, of in zip(mpc.lines, (0.0, lines.G, lines.lower, lines.upper), strict=True):
                into[:] = of
            mpc.moves = step.before
            began = perf_counter_ns()
            mpc._solve_rows()
            times[i] = (perf_counter_ns() - began) / 1000.0
        return times


class Daqp:
    """All lines, both bounds of each as rows."""

    def __init__(self, steps: list[Recorded]):
        self.problems = [self._rows(step) for step in steps]

    @staticmethod
    def _rows(step: Recorded) -> tuple[np.ndarray, ...]:
        p, q = step.rows, step.lines
        moves, count = len(q.g), len(q.lower)
        rows = np.zeros((2 * count, moves + SLACKS))
        rows[:count, :moves], rows[count:, :moves] = q.G, -q.G
        begin = 0
        for slack, end in enumerate(q.ends):
            rows[begin:end, moves + slack] = rows[count + begin : count + end, moves + slack] = -SLACK_UNIT
            begin = end
        upper = np.concatenate([np.minimum(p.x_u, 1e30), q.upper, -q.lower])
        lower = np.concatenate([p.x_l, np.full(2 * count, -1e30)])
        return np.ascontiguousarray(p.P), p.c.copy(), rows, upper, lower

    def __call__(self) -> np.ndarray:
        import daqp

        times = np.empty(len(self.problems))
        for i, problem in enumerate(self.problems):
            began = perf_counter_ns()
            daqp.solve(*problem, primal_tol=1e-10)
            times[i] = (perf_counter_ns() - began) / 1000.0
        return times


def figures(name: str, times: np.ndarray, piqp: np.ndarray, iterations: np.ndarray | None) -> None:
    ratio = times / piqp
    text = f"  {name:6s} {np.median(times):7.2f} {np.percentile(times, 99):7.2f} {np.median(ratio):7.3f}"
    text += f" {np.percentile(times, 99) / np.percentile(piqp, 99):7.3f}"
    print(text if iterations is None else f"{text} {np.median(iterations):5.0f} {iterations.max():4d}")


def main(passes: int) -> None:
    steps = [step for step in recorded() if step.bounded]
    cold, warm = Replay(steps, False), Replay(steps, True)
    solvers = {"piqp": Piqp(steps), "cold": cold, "warm": warm, "daqp": Daqp(steps)}
    least = {name: solve() for name, solve in solvers.items()}
    for _ in range(passes):
        for name, solve in solvers.items():
            least[name] = np.minimum(least[name], solve())
    scenes = np.array([step.scene for step in steps])
    print("us a solve: median, p99; over PIQP: median of ratios, ratio of p99; iterations: median, most")
    for scene in [*dict.fromkeys(scenes), "drives", "all"]:
        chosen = (scenes == scene) | (scene == "all") | ((scene == "drives") & (scenes != "hostile"))
        print(f"{scene}: {chosen.sum()} solves")
        for name, times in least.items():
            counted = solvers[name].iterations[chosen] if isinstance(solvers[name], Replay) else None
            figures(name, times[chosen], least["piqp"][chosen], counted)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else PASSES)
