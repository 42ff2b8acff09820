"""The filter's prediction and its signals on single slots."""

import numpy as np
from numba import njit

from sidestep.controller.perception.filter_motion import predict, touch
from sidestep.controller.perception.filter_update import expect
from sidestep.controller.perception.state_estimator import SLOT
from sidestep.controller.records import record

PERIOD = 0.02


def predicted(estimator, state, command, time=PERIOD):
    before, after = record(SLOT), record(SLOT)
    before["x"], before["command"], before["acceleration"], after["time"] = state, command, 0.0, time
    forward(before, after, estimator._car, estimator._settings, estimator._work)
    return after


@njit
def forward(before, after, cars, settings, work):
    touch(before[0], cars[0], settings[0])
    predict(before[0], after[0], cars[0], settings[0], work[0])


@njit
def shown(now, signal, cars, settings, work):
    touch(now[0], cars[0], settings[0])
    return expect(now[0], signal, cars[0], settings[0], work[0])


def state_at(speed):
    return np.array([3.0, -2.0, 0.7, speed, -0.02 * speed, 0.2, 0.05, 0.01, 0.004, -0.003, 0.02])
