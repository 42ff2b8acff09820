"""A log on one grid: SI units, ISO 8855 signs, gaps marked, spikes taken out; what was found on the way is said."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter
from scipy.signal import butter, sosfiltfilt

from sidestep.plant_models.errors import InputError
from sidestep.validation.model_error.logs.channel import Channel
from sidestep.validation.model_error.logs.channels import read_channels
from sidestep.validation.model_error.logs.mapping import SIGNALS, LogMap, SignalMap
from sidestep.validation.model_error.logs.names import find
from sidestep.validation.model_error.logs.units import factor, split_unit

Array = NDArray[np.float64]

PERIOD = 0.01
"""Of the grid that every signal is brought to, whatever its own rate, in [s]."""
LONGEST = 1e5
"""Of a log, in [s]: a day and more."""
HIGHEST = 5.0
"""Frequency up to which a car's lateral motion is compared, in [Hz]."""
LARGEST_GAP = 0.3
"""Time without samples [s], and with more than LATE of its periods, over which nothing is interpolated."""
LATE = 6.0
SURELY_OPPOSED = -0.5
"""Correlation below which a signal's sign is turned if it was not told."""
SPIKE = 9
"""Samples of the median that spikes are held against."""
_SMOOTH = {"v_x": 0.03, "a_x": 0.08, "yaw_rate": 0.03, "v_y": 0.04}
"""Standard deviation of the smoothing of inputs and starts, in [s]."""


@dataclass(frozen=True, eq=False)
class MeasuredLog:
    """What was measured.

    Attributes:
        name: Of the file.
        time: From 0 on, every PERIOD, shape (n,).
        signals: `steer` (at the road wheel, or at the steering wheel), `v_x`, `yaw_rate`, `a_x`, and `a_y`, `v_y` where
            measured, SI, shape (n,); `start_yaw_rate` and `start_v_y` are smoothed, the latter NaN where not measured.
        usable: Where all of them are there and the car is not slow, shape (n,).
        steer_gain: Road-wheel angle per `steer`: 1, or one over the told ratio; 0 if to be found.
        delays: Told, in [s], by signal.
        notes: Sentences on what was found.
    """

    name: str
    time: Array
    signals: Mapping[str, Array]
    usable: NDArray[np.bool_]
    steer_gain: float
    delays: Mapping[str, float]
    notes: tuple[str, ...]

    def smooth(self, name: str) -> Array:
        """A signal below HIGHEST, without phase: beyond it are vibration and noise."""
        sections = butter(4, HIGHEST * 2.0 * PERIOD, output="sos")
        return np.asarray(sosfiltfilt(sections, self.signals[name]), dtype=np.float64)

    def without(self, names: Collection[str]) -> "MeasuredLog":
        """The log without some signals."""
        signals = {name: values for name, values in self.signals.items() if name not in names}
        if "v_y" in names:
            signals["start_v_y"] = np.full(len(self.time), np.nan)
        return replace(self, signals=signals)

    def stretches(self, least: int) -> list[tuple[int, int]]:
        """Where at least so many samples in a row are usable: first, and one past the last."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], self.usable.astype(np.int8), [0]])))
        return [(a, b) for a, b in edges.reshape(-1, 2).tolist() if b - a >= least]


def load_log(path: Path, mapping: LogMap) -> MeasuredLog:
    """Read a log.

    Raises:
        InputError: File or mapping cannot be used, or steering, speed or yaw rate are not in it.
    """
    channels, notes = read_channels(path, mapping)
    maps = _maps(channels, mapping, str(path), notes)
    picked = {name: _picked(channels, maps[name], name, str(path)) for name in maps}
    start = max(c.time[0] for c in picked.values())
    end = min(c.time[-1] for c in picked.values())
    if end - start < 10.0:
        raise InputError(str(path), f"its signals share {max(end - start, 0.0):.1f} s", "at least 10 s")
    if end - start > LONGEST:
        raise InputError(str(path), f"its signals share {end - start:g} s", f"up to {LONGEST:g} s")
    time = np.arange(start, end, PERIOD)
    signals, usable = {}, np.ones(len(time), dtype=bool)
    for name, channel in picked.items():
        values, there = _on_grid(channel, time + (maps[name].delay or 0.0))
        signals[name], spikes = _without_spikes(values)
        usable &= there
        if spikes:
            notes.append(f"{name}: {spikes} spike{'s' if spikes > 1 else ''} taken out")
    _combined(signals, maps, time, usable, notes, mapping)
    missing = 1.0 - float(usable.mean())
    if missing > 0.001:
        notes.append(f"{missing:.1%} of the time is not used: gaps, or slower than {mapping.least_speed:g} m/s")
    wheel = maps.get("steering_wheel")
    gain = 1.0 if "steer" in maps else 1.0 / wheel.ratio if wheel and wheel.ratio else 0.0
    delays = {name: 0.0 for name, m in maps.items() if m.delay is not None}
    return MeasuredLog(path.name, time - time[0], signals, usable, gain, delays, tuple(notes))


def _maps(channels: Mapping[str, Channel], mapping: LogMap, where: str, notes: list[str]) -> dict[str, SignalMap]:
    """Told and found maps of all signals that there are."""
    maps = dict(mapping.signals)
    names = {name: split_unit(name)[0] for name in channels}
    for signal in SIGNALS:
        twin = {"steer": "steering_wheel", "steering_wheel": "steer", "v_y": "sideslip", "sideslip": "v_y"}.get(signal)
        if signal in maps or (twin and twin in maps):
            continue
        taken = {name for m in maps.values() for name in m.names}
        free = {plain: name for name, plain in names.items() if name not in taken and plain not in taken}
        if (word := find(signal, free)) is not None:
            maps[signal] = SignalMap(free[word])
            notes.append(f"{signal} found as {free[word]!r}")
    for needed in ("yaw_rate", "v_x", "steer"):
        if needed not in maps and not (needed == "steer" and "steering_wheel" in maps):
            known = ", ".join(sorted(channels)[:40])
            raise InputError(f"signals.{needed}", f"not told, and nothing in {where} is called so", known)
    return maps


def _picked(channels: Mapping[str, Channel], told: SignalMap, signal: str, where: str) -> Channel:
    found = []
    for name in told.names:
        key = next((key for key in channels if name in (key, split_unit(key)[0])), None)
        if key is None:
            raise InputError(f"signals.{signal}", f"no {name!r} in {where}", ", ".join(sorted(channels)[:60]))
        unit = channels[key].unit if told.unit is None else told.unit
        scale = factor(SIGNALS[signal], unit, f"signals.{signal}") * told.factor * (told.sign or 1)
        found.append(_clean(channels[key], scale, f"{where}: {name}"))
    if len(found) == 1:
        return found[0]
    first = found[0]
    rest = [np.interp(first.time, other.time, other.values) for other in found[1:]]
    return Channel(first.time, np.mean([first.values, *rest], axis=0))


def _clean(channel: Channel, scale: float, where: str) -> Channel:
    """Finite samples in rising order of time."""
    good = np.isfinite(channel.time) & np.isfinite(channel.values)
    time, values = channel.time[good], channel.values[good] * scale
    if len(time) < 10:
        raise InputError(where, f"{len(time)} numbers", "at least 10")
    rising = np.concatenate([[True], time[1:] > np.maximum.accumulate(time)[:-1]])
    if rising.mean() < 0.9:
        raise InputError(where, f"time runs backwards or stands in {1.0 - rising.mean():.0%} of the samples", "rising")
    return Channel(time[rising], values[rising])


def _on_grid(channel: Channel, time: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Interpolated values, and where a sample is near."""
    values = np.interp(time, channel.time, channel.values)
    gaps = np.diff(channel.time)
    wide = np.flatnonzero(gaps > max(LARGEST_GAP, LATE * float(np.median(gaps))))
    there = (time >= channel.time[0]) & (time <= channel.time[-1])
    for k in wide:
        there &= ~((time > channel.time[k]) & (time < channel.time[k + 1]))
    return values, there


def _without_spikes(values: Array) -> tuple[Array, int]:
    """Values whose single samples far off their neighbours' median are that median, and how many there were."""
    middle = median_filter(values, SPIKE)
    off = np.abs(values - middle)
    usual = np.sqrt(np.mean(np.sort(off)[: int(0.99 * len(off)) + 1] ** 2))
    steps = np.abs(np.diff(values))
    digit = float(np.median(steps[steps > 0.0])) if steps.any() else 0.0  # of a coarse sensor
    spikes = off > max(12.0 * usual, 0.25 * float(np.percentile(np.abs(middle), 99.0)), 4.0 * digit)
    return np.where(spikes, middle, values), int(spikes.sum())


def _combined(
    signals: dict[str, Array], maps: Mapping[str, SignalMap], time: Array, usable: NDArray[np.bool_], notes: list[str],
    mapping: LogMap,
) -> None:  # fmt: skip
    """Steering of either kind, sideslip as v_y, signs, smoothed inputs and starts; all in place."""
    if "steering_wheel" in signals:
        signals.setdefault("steer", signals.pop("steering_wheel"))
    smooth = {name: max(size / PERIOD, 1e-3) for name, size in _SMOOTH.items()}
    speed = gaussian_filter1d(signals["v_x"], smooth["v_x"])
    if float(np.median(speed)) < 0.0:
        speed = -speed
        notes.append("v_x runs backwards: taken with the other sign")
    signals["v_x"] = speed
    if "sideslip" in signals:
        sideslip = signals.pop("sideslip")
        if "v_y" not in signals:
            signals["v_y"] = speed * np.tan(sideslip)
    slow = np.asarray(binary_dilation(speed < mapping.least_speed, iterations=round(0.3 / PERIOD)), dtype=bool)
    usable &= ~slow
    _signed(signals, maps, usable, notes)
    position = (maps.get("v_y") or maps.get("sideslip") or SignalMap("")).position
    if "v_y" in signals:
        signals["v_y"] = signals["v_y"] - position * signals["yaw_rate"]
    along = np.gradient(speed, PERIOD) if "a_x" not in signals else signals["a_x"]
    signals["a_x"] = gaussian_filter1d(along, smooth["a_x"])
    signals["start_yaw_rate"] = gaussian_filter1d(signals["yaw_rate"], smooth["yaw_rate"])
    there = "v_y" in signals
    signals["start_v_y"] = gaussian_filter1d(signals["v_y"], smooth["v_y"]) if there else np.full(len(time), np.nan)


def _signed(
    signals: dict[str, Array], maps: Mapping[str, SignalMap], usable: NDArray[np.bool_], notes: list[str]
) -> None:
    """Signs that were not told: steering and acceleration have the yaw rate's, a_x is the speed's derivative."""
    if not usable.any():
        return
    turn, speed = signals["yaw_rate"][usable], signals["v_x"][usable]
    wheel = "steering_wheel" if "steering_wheel" in maps else "steer"
    pairs = [("steer", wheel, signals["steer"][usable], turn)]
    if "a_y" in signals:
        pairs.append(("a_y", "a_y", signals["a_y"][usable], turn * speed))
    for name, key, own, other in pairs:
        if maps[key].sign == 0 and own.std() * other.std() > 0.0 and np.corrcoef(own, other)[0, 1] < SURELY_OPPOSED:
            signals[name] = -signals[name]
            notes.append(f"{key} runs against the yaw rate: taken with the other sign")
