"""The filter's last half second: every record in order of time, so that what comes late is put where it belongs."""

import math
from typing import Any

from sidestep.controller.perception.filter_motion import predict
from sidestep.controller.perception.filter_update import update, update_again
from sidestep.controller.perception.state_estimator import SIGNALS, SLOTS, STATES, V_X, X
from sidestep.plant_models.kernels import bare_kernel


@bare_kernel
def slot(e: Any, i: Any) -> Any:
    """Slot number `i` in order of time, 0 for the oldest."""
    return e.slots[(e.first + i + SLOTS) % SLOTS]


@bare_kernel
def newest(e: Any) -> Any:
    """The slot of the newest record; only once there is one."""
    return slot(e, e.count - 1)


@bare_kernel
def _make_room(e, i):
    """Move inputs and verdicts of slot `i` and later ones up by one, into a ring that has room for them."""
    for k in range(e.count, i, -1):
        to, of = slot(e, k), slot(e, k - 1)
        to.time, to.command, to.acceleration = of.time, of.command, of.acceleration
        for signal in range(SIGNALS):
            to.z[signal], to.verdict[signal] = of.z[signal], of.verdict[signal]
    e.count += 1


@bare_kernel
def _begin(now, c):
    """State and covariance before anything is known."""
    now.steer_rate = 0.0
    for i in range(STATES):
        now.x[i] = 0.0
        for j in range(STATES):
            now.P[i, j] = 0.0
        now.P[i, i] = c.start[i] ** 2


@bare_kernel
def place_of(e: Any, time: Any) -> Any:
    """How many slots are not newer than `time`."""
    i = e.count
    while i > 0 and slot(e, i - 1).time > time:
        i -= 1
    return i


@bare_kernel
def _put(e, time, measured, first, last, c):
    """Make a slot for signals `first` to `last` of a measurement; its number, -1 if its time cannot be used."""
    if not math.isfinite(time):
        e.unusable += 1
        return -1
    i = place_of(e, time)
    too_late = e.count > 0 and (i == 0 or time < newest(e).time - c.reach)
    if too_late or (e.count == SLOTS and i == 1):
        e.too_late += 1
        return -1
    if e.count == SLOTS:
        e.first, e.count, i = (e.first + 1) % SLOTS, e.count - 1, i - 1
    _make_room(e, i)
    now = slot(e, i)
    now.time = time
    now.command = slot(e, i - 1).command if i > 0 else math.nan
    now.acceleration = slot(e, i - 1).acceleration if i > 0 else math.nan
    for signal in range(SIGNALS):
        now.z[signal] = measured.z[signal] if first <= signal < last else math.nan
    return i


@bare_kernel
def _insert(e, time, measured, first, last, car, c, w):
    i = _put(e, time, measured, first, last, c)
    if i < 0:
        return
    now = slot(e, i)
    if i == 0:
        _begin(now, c)
    else:
        predict(slot(e, i - 1), now, car, c, w)
    update(e, now, car, c, w)
    for k in range(i + 1, e.count):
        predict(slot(e, k - 1), slot(e, k), car, c, w)
        update_again(slot(e, k), car, c, w)


@bare_kernel
def take(e: Any, measured: Any, car: Any, c: Any, w: Any) -> None:
    """Take what sensors say, now or late, and bring the newest slot up to date.

    Args:
        e: Record of `ESTIMATE`, overwritten.
        measured: Record of `MEASUREMENT`.
        car: Record of `CAR`.
        c: Settings, record of `ESTIMATOR`.
        w: Work space, record of `FILTER`.
    """
    late = measured.pose_time < measured.time
    if measured.pose_time > measured.time:
        e.unusable += 1
    _insert(e, measured.time, measured, V_X if late or measured.pose_time > measured.time else X, SIGNALS, car, c, w)
    if late:
        _insert(e, measured.pose_time, measured, X, V_X, car, c, w)


@bare_kernel
def tell(estimates: Any, command: Any, acceleration: Any) -> None:
    """Road-wheel angle commanded [rad] and change of v_x expected [m/s^2] from the newest slot on; NaN: unknown."""
    e = estimates[0]
    if e.count > 0:
        now = newest(e)
        now.command, now.acceleration = command, acceleration


@bare_kernel
def step(estimates: Any, settings: Any, cars: Any, measured: Any, work: Any, out: Any) -> None:
    """`take` of records of shape (1,), and what is known then; `out` as of `look`."""
    take(estimates[0], measured[0], cars[0], settings[0], work[0])
    look(estimates, out)


@bare_kernel
def look(estimates: Any, out: Any) -> None:
    """Time and states of the newest slot into `out`, shape (12,); zeros if there is none."""
    e = estimates[0]
    now = newest(e)
    out[0] = now.time if e.count > 0 else 0.0
    for i in range(STATES):
        out[i + 1] = now.x[i] if e.count > 0 else 0.0
