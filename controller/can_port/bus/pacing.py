"""Absolute deadlines for a node on the bus: what is late is counted, what is missed is skipped, never made up for."""

import time
from collections.abc import Callable
from math import inf, nan
from typing import Any

import numpy as np


class Pacer:
    """Wakes its caller every `cycle` seconds, counted from the first wait.

    Args:
        cycle: Time between two deadlines, in [s].
        clock: Monotonic time, in [s].
        sleep: Waits for so many seconds, never less.

    Attributes:
        slot: Number of the present deadline.
        skipped: Deadlines that passed while the caller was busy.
    """

    def __init__(
        self,
        cycle: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self.cycle, self.slot, self.skipped = cycle, -1, 0
        self._clock, self._sleep = clock, sleep
        self._began = self._woke = 0.0
        self._phase = 0.0  # of the deadlines
        self._cycles: list[tuple[float, float, float]] = []  # deadline, lateness, time awake after it

    @property
    def time(self) -> float:
        """Time of the present deadline, in [s] from the first."""
        return self._phase + self.slot * self.cycle

    def now(self) -> float:
        """Time, in [s] from the first deadline."""
        return self._clock() - self._began if self.slot >= 0 else 0.0

    def wait(self) -> float:
        """Sleep until the next deadline that is still to come, or has just begun; returns its time, in [s]."""
        now = self._clock()
        if self.slot < 0:
            self._began = now
        else:
            self._cycles.append((self.time, self._woke - self._began - self.time, now - self._woke))
        missed = max(0, int((now - self._began - self._phase) / self.cycle) - self.slot - 1)
        self.slot, self.skipped = self.slot + 1 + missed, self.skipped + missed
        deadline = self._began + self.time
        if deadline > now:
            self._sleep(deadline - now)
        self._woke = self._clock()
        return self.time

    def follow(self, time: float) -> None:
        """Put the deadlines half a cycle behind `time`, in [s] from the first, and whole cycles later.

        Two nodes that wake at the same time delay each other, and how old a state is when it is used were chance.
        """
        self._phase += (time + 0.5 * self.cycle - self.time) % self.cycle

    def begin(self) -> None:
        """Figures count from the present deadline on."""
        self._cycles.clear()
        self.skipped = 0

    def statistics(self, until: float = inf) -> dict[str, Any]:
        """Figures of the finished cycles up to the deadline `until`, in [s].

        Lateness is in [ms], of waking, and for the latest end of a cycle of its end: a node that stood still while it
        was awake is woken in time for the next deadline that is left. Drift is by how much more than `cycle` the
        wake-ups are apart, as a share of it; busy is the share of the time between waking and waiting again, whoever
        had the processor.
        """
        cycles = np.array([row for row in self._cycles if row[0] <= until]).reshape(-1, 3)
        deadlines, lateness, awake = cycles.T
        p50, p99, most = 1e3 * np.percentile(lateness, (50, 99, 100)) if len(cycles) else (nan,) * 3
        drift = np.polyfit(deadlines, lateness, 1)[0] if len(cycles) > 1 else 0.0
        busy = np.sum(awake) / (np.ptp(deadlines) + self.cycle) if len(cycles) else 0.0
        return {
            "cycles": len(cycles), "skipped": self.skipped, "drift": float(drift), "busy": float(busy),
            "lateness_ms": {"p50": float(p50), "p99": float(p99), "max": float(most)},
            "latest_end_ms": float(1e3 * np.max(lateness + awake)) if len(cycles) else nan,
        }  # fmt: skip
