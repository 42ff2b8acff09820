"""A car and its sensors from a log: fits, which signals agree, and what the data do not tell.

Order: is there enough steering; fit all signals in short windows, then in windows of WINDOW; a signal whose motion the
fitted car cannot explain contradicts the others and is left out of a second fit; then every parameter is judged.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.model_error.identification.car_kernel import Chassis, Values, simulate
from sidestep.validation.model_error.identification.log_parameters import (
    BY_NAME,
    Parameter,
    begin,
    free_parameters,
    implausible,
)
from sidestep.validation.model_error.identification.window_fit import CHANNELS, Fit, Windows, delayed, fit
from sidestep.validation.model_error.logs.measured import PERIOD, MeasuredLog

Array = NDArray[np.float64]

SHORT, WINDOW = 1.0, 3.0
"""Windows of the first fit, which finds the way, and of the second, in [s]."""
EDGES = 30
"""Samples that a window has beyond its length, for the delays."""
MOST_WINDOWS = 240
LEAST_TIME = 20.0
"""Usable time below which nothing is fitted, in [s]."""
LEAST_ACCELERATION = 1.0
"""95th percentile of v_x |yaw rate| below which a log has too little steering, in [m/s^2]."""
LEAST_EXPLAINED = {"yaw_rate": 0.9, "a_y": 0.8, "v_y": 0.5}
"""Share of a signal's variance below which it contradicts the others."""
NEED_TWO = ("I_z", "C_f", "C_r", "mu_f", "mu_r", "relaxation")
"""Parameters that take a_y or v_y beside the yaw rate."""
COLLINEAR = 0.98
FIRST_SCALE = {"yaw_rate": 0.012, "a_y": 1.0, "v_y": 0.12}
_UNTOLD_RATIO = BY_NAME["steer_gain"].spread * 3.0


@dataclass(frozen=True, eq=False)
class Verdict:
    """One parameter.

    Attributes:
        parameter: Which.
        value: In its unit.
        low, high: 95 % confidence interval.
        refused: Why it must not be used; empty if it may.
    """

    parameter: Parameter
    value: float
    low: float
    high: float
    refused: str


@dataclass(frozen=True, eq=False)
class LogIdentification:
    """What a log tells.

    Attributes:
        values: Car and sensors as fitted; refused ones as they fit best beside what was known.
        linear: The best that a car with linear tyres can do.
        verdicts: Of every parameter that was fitted.
        explained: Share of each signal's variance in windows of WINDOW, by signal; also of those left out.
        left_out: Signals that contradict the others, and the reason.
        problem: Why nothing can be identified; empty if something can.
        notes: Sentences.
    """

    values: Values
    linear: Values
    verdicts: tuple[Verdict, ...]
    explained: Mapping[str, float]
    left_out: Mapping[str, str]
    problem: str
    notes: tuple[str, ...]

    def known(self, name: str) -> bool:
        """Whether a parameter was identified."""
        return any(v.parameter.name == name and not v.refused for v in self.verdicts)


def windows_of(
    log: MeasuredLog,
    length: float,
    channels: tuple[str, ...],
    part: slice = slice(None),
    most: int | None = MOST_WINDOWS,
) -> Windows:
    """Windows side by side in all usable stretches.

    Args:
        log: The log.
        length: In [s].
        channels: To compare.
        part: Of the windows, such as every other one.
        most: So many at most, evenly taken; None for all.
    """
    steps = round(length / PERIOD)
    starts = [np.arange(a, b - steps - EDGES, steps) for a, b in log.stretches(steps + EDGES + 1)]
    found = np.concatenate([np.zeros(0, np.int64), *starts]).astype(np.int64)[part]
    if most and len(found) > most:
        found = found[np.linspace(0, len(found) - 1, most).round().astype(np.int64)]
    return Windows(log.signals, found, steps + EDGES, channels)


def identify_log(
    log: MeasuredLog, vehicle: VehicleParameters, rear_drive: float = 1.0, part: slice = slice(None)
) -> LogIdentification:
    """Identify car and sensors.

    Args:
        log: The log.
        vehicle: Mass and geometry; the height of the centre of gravity is where that begins.
        rear_drive: Share of the drive at the rear axle.
        part: Of the windows to fit.

    Raises:
        InputError: There is next to nothing in the log.
    """
    chassis = Chassis.of(vehicle, rear_drive)
    if (usable := float(log.usable.sum()) * PERIOD) < LEAST_TIME:
        raise InputError(log.name, f"{usable:.0f} s can be used", f"at least {LEAST_TIME:g} s above the least speed")
    problem, notes = _excitation(log, chassis), list(log.notes)
    channels = tuple(name for name in CHANNELS if name in log.signals)
    start = begin(chassis, log.steer_gain or _guessed_gain(log, chassis), vehicle.cg_height)
    if problem:
        refused = [
            Verdict(p, float(getattr(start, p.name)), -np.inf, np.inf, problem)
            for p in free_parameters(channels, False)
        ]
        return LogIdentification(start, start, tuple(refused), {}, {}, problem, tuple(notes))
    left_out: dict[str, str] = {}
    found = _fitted(log, start, channels, chassis, False, part)
    shares = explained(log, found.values, chassis, channels)
    odd = implausible(found.values, chassis)
    for name in channels[1:]:
        if shares[name] < LEAST_EXPLAINED[name]:
            left_out[name] = f"contradicts the yaw rate: the car that fits best explains {shares[name]:.0%} of it"
        elif odd and name == channels[-1]:
            words = "; ".join(f"{key} {why}" for key, why in odd.items())
            left_out[name] = f"contradicts the yaw rate: it takes a car with {words}"
    used = tuple(name for name in channels if name not in left_out)
    if left_out:
        log = log.without(left_out)
        found = _fitted(log, start, used, chassis, False, part)
        shares = explained(log, found.values, chassis, used) | {name: shares[name] for name in left_out}
    linear = _fitted(log, start, used, chassis, True, part)
    if shares["yaw_rate"] < LEAST_EXPLAINED["yaw_rate"]:
        problem = f"no car explains more than {shares['yaw_rate']:.0%} of the yaw rate: wrong signal, unit or ratio?"
    verdicts = tuple(_judged(found, used, left_out, problem, chassis))
    return LogIdentification(found.values, linear.values, verdicts, shares, left_out, problem, tuple(notes))


def explained(log: MeasuredLog, values: Values, chassis: Chassis, channels: tuple[str, ...]) -> dict[str, float]:
    """Share of each signal's variance below 5 Hz in windows of WINDOW from measured starts."""
    windows = windows_of(log, WINDOW, channels)
    still = np.zeros((len(windows.starts), 4))
    out = delayed(simulate(values, chassis, log.signals, windows.starts, windows.steps, still, False), values)
    index, result = windows.starts[:, None] + np.arange(windows.steps), {}
    for name in channels:
        measured = log.smooth(name)[index]
        rest = out[:, :, CHANNELS.index(name)] - measured
        with np.errstate(over="ignore", invalid="ignore"):
            share = 1.0 - float(np.var(rest)) / max(float(np.var(measured)), 1e-12)
        result[name] = share if np.isfinite(share) else -np.inf
    return result


def _excitation(log: MeasuredLog, chassis: Chassis) -> str:
    turn = np.abs(log.smooth("yaw_rate") * log.signals["v_x"])[log.usable]
    largest = float(np.percentile(turn, 95.0))
    if largest >= LEAST_ACCELERATION:
        return ""
    angle = float(np.percentile(np.abs(log.signals["steer"][log.usable]), 95.0)) * 180.0 / np.pi
    where = "at the road wheel" if log.steer_gain == 1.0 else "at the steering wheel"
    return (
        f"too little steering: 95 % of the time below {angle:.2g} deg {where} and {largest:.2g} m/s² "
        f"({LEAST_ACCELERATION:g} m/s² needed)"
    )


def _guessed_gain(log: MeasuredLog, chassis: Chassis) -> float:
    """Road-wheel angle per steering-wheel angle, as a car rolls without slip through its slowest half."""
    speed = log.signals["v_x"]
    chosen = log.usable & (speed <= np.median(speed[log.usable]))
    wanted = log.smooth("yaw_rate")[chosen] * (chassis.l_f + chassis.l_r) / speed[chosen]
    angle = log.signals["steer"][chosen] - log.signals["steer"][chosen].mean()
    slope = float(angle @ (wanted - wanted.mean())) / max(float(angle @ angle), 1e-12)
    return min(max(slope, 0.02), 1.5)


def _fitted(
    log: MeasuredLog, start: Values, channels: tuple[str, ...], chassis: Chassis, linear: bool, part: slice
) -> Fit:
    free = free_parameters(channels, linear, _told(log))
    if not log.steer_gain:
        free = tuple(replace(p, spread=_UNTOLD_RATIO) if p.name == "steer_gain" else p for p in free)
    scale, steps, result = np.array([FIRST_SCALE[name] for name in channels]), None, None
    for length in (SHORT, WINDOW):
        result = fit(windows_of(log, length, channels, part), start, free, chassis, scale, linear, True, steps)
        scale, steps = result.scale, result.steps
    assert result is not None
    return result


def _told(log: MeasuredLog) -> list[str]:
    """Delays that the mapping tells have been taken out."""
    names = {"steer": "steer_delay", "steering_wheel": "steer_delay", "a_y": "a_y_delay", "v_y": "v_y_delay"}
    return [names[name] for name in log.delays if name in names]


def _judged(
    found: Fit, channels: tuple[str, ...], left_out: Mapping[str, str], problem: str, chassis: Chassis
) -> list[Verdict]:
    deviation = np.sqrt(np.diag(found.covariance))
    correlation, odd = found.correlation, implausible(found.values, chassis)
    result = []
    for i, p in enumerate(found.free):
        value = float(getattr(found.values, p.name))
        spread = float(np.hypot(deviation[i] * p.spread, p.least))
        pair = (1.96 * spread) * np.array([-1.0, 1.0])
        low, high = value * np.exp(pair) if p.positive else value + pair
        reason = problem or _reason(p, spread, correlation[i], found.free, i, channels, left_out)
        reason = reason or odd.get(p.name, "")
        result.append(Verdict(p, value, float(low), float(high), reason))
    return result


def _reason(
    p: Parameter, spread: float, correlation: Array, free: tuple[Parameter, ...], i: int, channels: tuple[str, ...],
    left_out: Mapping[str, str],
) -> str:  # fmt: skip
    if p.name in NEED_TWO and channels == ("yaw_rate",):
        why = "; ".join(f"{name} {words}" for name, words in left_out.items()) or "no a_y and no v_y in the log"
        return f"yaw rate alone cannot tell stiffness and inertia apart, and {why}"
    other = int(np.argmax(np.where(np.arange(len(free)) == i, 0.0, np.abs(correlation))))
    if spread > p.known:
        size = f"{1.96 * spread:.0%}" if p.positive else f"{1.96 * spread:.2g} {p.unit}"
        if spread > 0.6 * p.spread:
            return f"the data do not tell: ± {size}, hardly less than assumed beforehand"
        beside = f", goes with {free[other].name} ({correlation[other]:+.2f})" if abs(correlation[other]) > 0.7 else ""
        return f"known to no better than ± {size}{beside}"
    if abs(correlation[other]) > COLLINEAR:
        return f"collinear with {free[other].name}: correlation {correlation[other]:+.3f}"
    return ""
