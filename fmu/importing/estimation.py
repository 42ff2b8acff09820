"""Signals that a foreign FMU does not report, worked out from those that it does.

Rates are backward differences of second order over the last two steps (of first order after the first step).

    yaw          the start's, and the integral of yaw_rate; without one, the direction of travel
    yaw_rate     rate of yaw
    v_x, v_y     rates of x and y, turned into the car's axes
    steer_angle  the command in force
"""

import math
from collections import deque
from collections.abc import Sequence

from sidestep.fmu.importing.mapping import OUTPUTS
from sidestep.plant_models.signals import VehicleState

SLOWEST = 0.1
"""Speed below which the direction of travel says nothing, in [m/s]."""


class Estimator:
    """Completes the signals of one drive, step by step."""

    def __init__(self, missing: Sequence[str]):
        self._missing = frozenset(missing)
        self._integrates = "yaw" in missing and "yaw_rate" not in missing

    def reset(self, start: VehicleState, signals: dict[str, float]) -> dict[str, float]:
        """The first instant: what is missing is as at `start`."""
        complete = {name: getattr(start, name) for name in self._missing} | signals
        self._past = deque([(start.time, complete)], maxlen=2)
        return complete

    def complete(self, time: float, signals: dict[str, float], steer_angle: float) -> dict[str, float]:
        """All signals of `OUTPUTS` at `time` [s], from those that the FMU reports and the command in force [rad]."""
        now, missing = dict(signals), self._missing
        if "steer_angle" in missing:
            now["steer_angle"] = steer_angle
        if "yaw" in missing:
            now["yaw"] = self._yaw(time, now)
        if "yaw_rate" in missing:
            now["yaw_rate"] = self._rate("yaw", time, now)
        if missing & {"v_x", "v_y"}:
            east, north = self._rate("x", time, now), self._rate("y", time, now)
            c, s = math.cos(now["yaw"]), math.sin(now["yaw"])
            now = {"v_x": c * east + s * north, "v_y": c * north - s * east} | now
        self._past.append((time, now))
        return {name: now[name] for name in OUTPUTS}

    def _yaw(self, time: float, now: dict[str, float]) -> float:
        then, before = self._past[-1]
        if self._integrates:
            return before["yaw"] + 0.5 * (time - then) * (before["yaw_rate"] + now["yaw_rate"])
        east, north = self._rate("x", time, now), self._rate("y", time, now)
        if math.hypot(east, north) < SLOWEST:
            return before["yaw"]
        sideslip = math.atan2(now["v_y"], now["v_x"]) if not self._missing & {"v_x", "v_y"} else 0.0
        return unwrapped(math.atan2(north, east) - sideslip, before["yaw"])

    def _rate(self, name: str, time: float, now: dict[str, float]) -> float:
        (then, last), value = self._past[-1], now[name]
        first = (value - last[name]) / (time - then)
        if len(self._past) < 2:
            return first
        long_ago, older = self._past[0]
        second = (last[name] - older[name]) / (then - long_ago)
        return first + (first - second) * (time - then) / (time - long_ago)


def unwrapped(angle: float, near: float) -> float:
    """The same direction as `angle`, within half a turn of `near`, in [rad]."""
    return angle + math.tau * round((near - angle) / math.tau)
