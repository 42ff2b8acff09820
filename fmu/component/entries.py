"""The functions of a component that are compiled from kernels, as C calls them: pointers to records, and counts."""

import numba
import numpy as np
from numba import carray, types  # pyright: ignore[reportPrivateImportUsage]

from sidestep.controller.records import MEMORY, SETTINGS, STATE, WORK
from sidestep.controller.step import BOUNDED, finish, step
from sidestep.fmu.component.clearance import clearance
from sidestep.fmu.component.records import BOX_FIELDS, PARAMETERS, SETUP
from sidestep.fmu.component.tuning import tune

_COLUMNS = len(BOX_FIELDS)


def _pointer(dtype: np.dtype) -> types.CPointer:
    return types.CPointer(numba.from_dtype(dtype))


def _step(memory, settings, table, rows, period, boxes, count, state, work):
    m, c, states, w = carray(memory, 1), carray(settings, 1), carray(state, 1), carray(work, 1)
    done = step(m, c, carray(table, (rows, 6)), period, carray(boxes, (count, _COLUMNS)), states, w)
    if done == BOUNDED:  # the active set came to no end: there is no other solver here
        finish(m, c, states, w, False)
    return done


def _tune(memory, settings, setup, given):
    tune(carray(memory, 1), carray(settings, 1), carray(setup, 1), carray(given, 1))
    return 0


def _clearance(setup, table, rows, boxes, count, state):
    return clearance(carray(setup, 1), carray(table, (rows, 6)), carray(boxes, (count, _COLUMNS)), carray(state, 1))


_NUMBERS, _COUNT, _NUMBER = types.CPointer(types.float64), types.int64, types.float64
ENTRIES = {
    "step": (_step, types.int64(
        _pointer(MEMORY), _pointer(SETTINGS), _NUMBERS, _COUNT, _NUMBER, _NUMBERS, _COUNT, _pointer(STATE),
        _pointer(WORK),
    )),
    "tune": (_tune, types.int64(_pointer(MEMORY), _pointer(SETTINGS), _pointer(SETUP), _pointer(PARAMETERS))),
    "clearance": (_clearance, types.float64(
        _pointer(SETUP), _NUMBERS, _COUNT, _NUMBERS, _COUNT, _pointer(STATE)
    )),
}  # fmt: skip
"""Function and signature by name; in C, `sidestep_kernel_` stands before it."""
