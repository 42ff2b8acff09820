"""Absolute deadlines for a node on the bus: what is late is counted, what is missed is skipped, never made up for."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np


class Pacer:
    """Wakes its caller every `cycle` seconds, counted from the first wait.

    Args:
        cycle: Time between two deadlines, in [s].
        clock: Monotonic time, in [s].
        sleep: Waits for so many seconds.

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
        self._began = 0.0
        self._woken: list[tuple[int, float]] = []  # slot, lateness

    @property
    def time(self) -> float:
        """Time of the present deadline, in [s] from the first."""
        return self.slot * self.cycle

    def now(self) -> float:
        """Time, in [s] from the first deadline."""
        return self._clock() - self._began if self.slot >= 0 else 0.0

    def wait(self) -> float:
        """Sleep until the next deadline that is still to come, or has just begun; returns its time, in [s]."""
        now = self._clock()
        if self.slot < 0:
            self._began = now
        missed = max(0, int((now - self._began) / self.cycle) - self.slot - 1)
        self.slot, self.skipped = self.slot + 1 + missed, self.skipped + missed
        deadline = self._began + self.time
        if deadline > now:
            self._sleep(deadline - now)
        self._woken.append((self.slot, self._clock() - deadline))
        return self.time

    def statistics(self) -> dict[str, Any]:
        """Lateness in [ms], and drift: by how much more than `cycle` the wake-ups are apart, as a share of it."""
        slots, lateness = np.array(self._woken).reshape(-1, 2).T
        p50, p99, most = 1e3 * np.percentile(lateness, (50, 99, 100)) if len(slots) else (np.nan,) * 3
        drift = np.polyfit(slots, lateness, 1)[0] / self.cycle if len(slots) > 1 else 0.0
        return {
            "cycles": len(slots), "skipped": self.skipped, "drift": float(drift),
            "lateness_ms": {"p50": float(p50), "p99": float(p99), "max": float(most)},
        }  # fmt: skip
