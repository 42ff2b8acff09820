"""Models held against a log that they do not see but for its steering and speed, in windows from measured starts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidestep.validation.model_error.identification.car_kernel import Chassis, Values, simulate
from sidestep.validation.model_error.identification.log_identification import WINDOW, windows_of
from sidestep.validation.model_error.identification.window_fit import CHANNELS, Windows, delayed, own_of
from sidestep.validation.model_error.logs.measured import PERIOD, MeasuredLog
from sidestep.validation.model_error.prediction_error import HORIZON_TIME, SPACING

Array = NDArray[np.float64]

MODELS = ("linear", "Magic Formula", "Magic Formula, bank from the 2 s before", "Magic Formula, the log's own bank")
"""The last knows, from the window itself, how the road is banked: a bound of what that is worth, no prediction."""
BEFORE = 2.0
"""Time over which the bank is learned, in [s]."""
RANGES = ((0.0, 4.0), (4.0, 7.0), (7.0, 10.0), (10.0, np.inf))
"""Of the mean lateral acceleration over the horizon, in [m/s^2]."""
MANOEUVRES = ("straight", "steady turn", "turning in", "turning out", "change of direction", "braking in a turn")
LEAST_STARTS = 10
"""Starting points below which a cell is not judged."""


@dataclass(frozen=True, eq=False)
class Starts:
    """Starting points of predictions, all over the log.

    Attributes:
        index: Shape (w,).
        speed: Mean over the horizon, shape (w,), in [m/s].
        lateral: Mean size of the measured lateral acceleration over the horizon, shape (w,), in [m/s^2].
        manoeuvre: Of MANOEUVRES by number, shape (w,).
    """

    index: NDArray[np.int64]
    speed: Array
    lateral: Array
    manoeuvre: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Scores:
    """Of one model.

    Attributes:
        model: Its name.
        explained: Share of variance by signal over all windows of WINDOW: `yaw_rate`, and `a_y`, `v_y` if measured.
        explained_raw: The same with noise and vibration above 5 Hz in the measurement.
        offset: Error of the lateral offset HORIZON_TIME ahead at every starting point, shape (w,), in [m].
    """

    model: str
    explained: Mapping[str, float]
    explained_raw: Mapping[str, float]
    offset: Array


def starts_of(log: MeasuredLog) -> Starts:
    """Starting points SPACING apart with the time before and after them that predictions take."""
    length, before = round(HORIZON_TIME / PERIOD), round(BEFORE / PERIOD) + 30
    parts = [np.arange(a + before, b - length - 30, round(SPACING / PERIOD)) for a, b in log.stretches(before + length)]
    index = np.concatenate([np.zeros(0, np.int64), *parts]).astype(np.int64)
    window = index[:, None] + np.arange(length + 1)
    turn = log.smooth("yaw_rate") * log.signals["v_x"]
    lateral = (log.smooth("a_y") if "a_y" in log.signals else turn)[window]
    return Starts(
        index, log.signals["v_x"][window].mean(axis=1), np.abs(lateral).mean(axis=1),
        _manoeuvres(lateral, log.signals["a_x"][window]),
    )  # fmt: skip


def _manoeuvres(lateral: Array, along: Array) -> NDArray[np.int64]:
    quarter = lateral.shape[1] // 4
    first, last = lateral[:, :quarter].mean(axis=1), lateral[:, -quarter:].mean(axis=1)
    size, change = np.abs(lateral).mean(axis=1), np.abs(last) - np.abs(first)
    kind = np.where(change > 1.5, 2, np.where(change < -1.5, 3, 1))
    kind = np.where((first * last < 0.0) & (np.minimum(np.abs(first), np.abs(last)) > 1.0), 4, kind)
    kind = np.where((along.mean(axis=1) < -2.0) & (size > 2.0), 5, kind)
    return np.where(size < 1.0, 0, kind)


def score_all(
    log: MeasuredLog, values: Values, linear: Values, chassis: Chassis, starts: Starts, part: slice = slice(None)
) -> list[Scores]:
    """Scores of every one of MODELS; of the shares of variance in a part of the windows alone."""
    windows = windows_of(log, WINDOW, _channels(log), part, None)
    ahead = Windows(log.signals, starts.index, round(HORIZON_TIME / PERIOD) + 2, _channels(log))
    shift = round(BEFORE / PERIOD) + 30
    result = []
    for model in MODELS:
        car, extra = (linear if model == "linear" else values), []
        for w in (windows, ahead):
            moved = np.zeros((len(w.starts), 4))
            if "before" in model:
                early = Windows(log.signals, np.maximum(w.starts - shift, 0), shift, w.channels)
                moved[:, 2:] = own_of(early, car, chassis)[:, 2:].mean(axis=1, keepdims=True)
            elif "own" in model:
                moved[:, 2:] = own_of(w, car, chassis)[:, 2:]
            extra.append(moved)
        is_linear = model == "linear"
        smooth, raw = _explained(log, windows, car, chassis, extra[0], is_linear)
        result.append(Scores(model, smooth, raw, offset_errors(log, ahead, car, chassis, extra[1], is_linear)))
    return result


def _channels(log: MeasuredLog) -> tuple[str, ...]:
    return tuple(name for name in CHANNELS if name in log.signals)


def _explained(
    log: MeasuredLog, windows: Windows, values: Values, chassis: Chassis, moved: Array, linear: bool
) -> tuple[dict[str, float], dict[str, float]]:
    out = delayed(simulate(values, chassis, log.signals, windows.starts, windows.steps, moved, linear), values)
    steps = round(WINDOW / PERIOD)
    index = windows.starts[:, None] + np.arange(steps)
    smooth, raw = {}, {}
    for name in windows.channels:
        model = out[:, :steps, CHANNELS.index(name)]
        for result, measured in ((smooth, log.smooth(name)[index]), (raw, log.signals[name][index])):
            result[name] = 1.0 - float(np.var(model - measured) / np.var(measured))
    return smooth, raw


def offset_errors(
    log: MeasuredLog, windows: Windows, values: Values, chassis: Chassis, moved: Array, linear: bool
) -> Array:
    """Lateral offset of the model from the measured path, HORIZON_TIME ahead, shape (w,), in [m].

    The measured path is integrated from speed, yaw rate and sideslip less their offsets and delays; where no sideslip
    is measured the model's own is taken for both, and the error is that of the heading alone.
    """
    out = simulate(values, chassis, log.signals, windows.starts, windows.steps, moved, linear)
    steps = round(HORIZON_TIME / PERIOD) + 1
    index = windows.starts[:, None] + np.arange(steps)
    speed = log.signals["v_x"][index]
    r, v_y = out[:, :steps, 0] - values.yaw_rate_offset, out[:, :steps, 2] - values.sideslip_offset * speed
    truth_r, truth_v_y = log.signals["yaw_rate"][index] - values.yaw_rate_offset, v_y
    if "v_y" in log.signals:
        truth_v_y = measured_v_y(log, values)[index]
    return _offset(r, v_y, speed)[:, -1] - _offset(truth_r, truth_v_y, speed)[:, -1]


def measured_v_y(log: MeasuredLog, values: Values) -> Array:
    """Measured lateral velocity of the centre of gravity less offset and delay, shape (n,), in [m/s]."""
    place = np.arange(len(log.time))
    on_time = np.interp(place + values.v_y_delay / PERIOD, place, log.signals["v_y"])
    return on_time - values.sideslip_offset * log.signals["v_x"]


def _offset(r: Array, v_y: Array, speed: Array) -> Array:
    """Lateral offset from the heading at the start, by the trapezoidal rule, shape as `r`."""
    yaw = _integrated(r)
    return _integrated(speed * np.sin(yaw) + v_y * np.cos(yaw))


def _integrated(rate: Array) -> Array:
    steps = 0.5 * PERIOD * (rate[:, 1:] + rate[:, :-1])
    return np.concatenate([np.zeros((len(rate), 1)), np.cumsum(steps, axis=1)], axis=1)


def p95(errors: Array, chosen: NDArray[np.bool_]) -> float:
    """95th percentile of the errors' size; NaN with fewer than LEAST_STARTS."""
    return float(np.percentile(np.abs(errors[chosen]), 95.0)) if chosen.sum() >= LEAST_STARTS else float("nan")


def by_range(starts: Starts, ranges: Sequence[tuple[float, float]] = RANGES) -> list[NDArray[np.bool_]]:
    """Starting points of each range of lateral acceleration."""
    return [(starts.lateral >= low) & (starts.lateral < high) for low, high in ranges]
