"""What a step of the state estimator costs, read by a clock between the steps in compiled code.

    python benchmarks/perception/estimator_cost.py [passes]

A car at 15 m/s, a record every 20 ms with v_x, yaw rate, steering angle and lateral acceleration, the pose at 10 Hz and
late by some time: then as many steps are done again as have passed since. Every step's time is the least of all passes,
which takes out what other programs on the machine do to it.
"""

import ctypes
import math
import sys

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sidestep.controller.perception.estimator import StateEstimator
from sidestep.controller.perception.filter_history import step, tell
from sidestep.controller.perception.state_estimator import (
    LATERAL,
    MEASUREMENT,
    STATES,
    STEER,
    V_X,
    YAW,
    YAW_RATE,
    X,
)  # fmt: skip
from sidestep.plant_models.vehicle.parameters import VehicleParameters

COUNT, PERIOD, POSE_STEPS, SPEED, PASSES = 2000, 0.02, 5, 15.0, 15
_clock = ctypes.CDLL(None).clock_gettime
_clock.argtypes, _clock.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_int


@njit
def replay(estimates, settings, cars, measured, work, out, microseconds):
    """Take the measurements in turn."""
    now = np.zeros(4, dtype=np.int64)
    address = now.ctypes.data
    for i in range(len(measured)):
        _clock(1, address)
        began = now[0] * 1000000000 + now[1]
        step(estimates, settings, cars, measured[i : i + 1], work, out)
        tell(estimates, 0.0, math.nan)
        _clock(1, address)
        microseconds[i] = (now[0] * 1000000000 + now[1] - began) / 1000.0


def measurements(late: float) -> NDArray[np.void]:
    """Straight on, without noise."""
    made = np.zeros(COUNT, MEASUREMENT)
    made["time"], made["pose_time"], made["z"] = PERIOD * np.arange(COUNT), math.nan, math.nan
    made["z"][:, [V_X, YAW_RATE, STEER, LATERAL]] = SPEED, 0.0, 0.0, 0.0
    fixed = made[::POSE_STEPS]
    fixed["pose_time"] = fixed["time"] - late
    fixed["z"][:, X : YAW + 1] = 0.0
    fixed["z"][:, X] = SPEED * fixed["pose_time"]
    return made


def main(passes: int) -> None:
    filtered, out = StateEstimator(VehicleParameters.preset("bmw-320i")), np.zeros(STATES + 1)
    print(f"record of {filtered._estimate.itemsize} bytes")
    print("pose late by [s]: us a step, median of those without a pose; of those with one: median, most")
    for late in (0.0, 0.02, 0.1, 0.2, 0.5):
        measured, least = measurements(late), np.full(COUNT, np.inf)
        for _ in range(passes):
            filtered.reset()
            times = np.empty(COUNT)
            replay(filtered._estimate, filtered._settings, filtered._car, measured, filtered._work, out, times)
            least = np.minimum(least, times)
        pose = np.arange(COUNT) % POSE_STEPS == 0
        pose[:100], rest = False, ~pose
        print(f"{late:5.2f}: {np.median(least[rest]):6.2f} {np.median(least[pose]):6.2f} {least[pose].max():6.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else PASSES)
