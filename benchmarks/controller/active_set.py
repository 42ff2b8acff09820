"""The active set beside PIQP and DAQP, on the QPs of real drives in which a bound acts.

    python benchmarks/controller/active_set.py [passes]

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

from sidestep.controller.mpc.active_set.solver import solve_with_bounds
from sidestep.controller.mpc.piqp_solver import PiqpSolver
from sidestep.controller.mpc.stack import SLACK_UNIT
from sidestep.controller.records import MEMORY, SLACKS, record
from sidestep.validation.studies.recorded_problems import Recorded, recorded

PASSES = 7
_clock = ctypes.CDLL(None).clock_gettime
_clock.argtypes, _clock.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_int


@njit
def replay(works, settings, begins, warm, memory, microseconds, iterations):
    """Solve problems in turn; each warm solve starts from the step before unless a drive begins."""
    now = np.zeros(4, dtype=np.int64)
    address, m = now.ctypes.data, memory[0]
    for i in range(begins.shape[0]):
        if begins[i] or not warm:
            m.active.count = 0
        _clock(1, address)
        start = now[0] * 1000000000 + now[1]
        solve_with_bounds(m, works[i], settings[i])
        _clock(1, address)
        microseconds[i] = (now[0] * 1000000000 + now[1] - start) / 1000.0
        iterations[i] = works[i].iterations


class Replay:
    """All recorded problems for the active set."""

    def __init__(self, steps: list[Recorded], warm: bool):
        self.works = np.concatenate([step.work for step in steps])
        self.settings = np.concatenate([step.settings for step in steps])
        self.begins = np.array([i == 0 or steps[i - 1].scene != s.scene for i, s in enumerate(steps)])
        self.warm, self.memory = warm, record(MEMORY)
        self.iterations = np.zeros(len(steps), dtype=np.int64)

    def __call__(self) -> np.ndarray:
        times = np.empty(len(self.begins))
        replay(self.works, self.settings, self.begins, self.warm, self.memory, times, self.iterations)
        return times


class Piqp:
    """PIQP as the controller uses it."""

    def __init__(self, steps: list[Recorded]):
        c = steps[0].settings[0]
        self.steps = steps
        self.solver = PiqpSolver(int(c["grid"]["moves"]), int(steps[0].work["count"][0]), float(c["car"]["rate_limit"]))

    def __call__(self) -> np.ndarray:
        times = np.empty(len(self.steps))
        for i, step in enumerate(self.steps):
            began = perf_counter_ns()
            self.solver.solve(step.work, step.before)
            times[i] = (perf_counter_ns() - began) / 1000.0
        return times


class Daqp:
    """All lines, both bounds of each as rows."""

    def __init__(self, steps: list[Recorded]):
        self.problems = [self._rows(step) for step in steps]

    @staticmethod
    def _rows(step: Recorded) -> tuple[np.ndarray, ...]:
        p, w = step.rows, step.work[0]
        moves, count = len(p.c) - SLACKS, int(w["count"])
        rows, slopes, slack = np.zeros((2 * count, moves + SLACKS)), w["slopes"][:count, :moves], w["slack"][:count]
        rows[:count, :moves], rows[count:, :moves] = slopes, -slopes
        soft = np.flatnonzero(slack < SLACKS)
        rows[soft, moves + slack[soft]] = rows[soft + count, moves + slack[soft]] = -SLACK_UNIT
        high, low, values = w["high"][:count], w["low"][:count], w["lines"][:count]
        upper = np.concatenate([np.minimum(p.x_u, 1e30), high - values, values - low])
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
