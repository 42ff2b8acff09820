"""A smooth path along a polyline: a spline where that holds to it, and a smoothed curve where not, see `smoothing`.

The spline goes through the points, its parameter chord length, which is most exact, or, where that fails, the square
root of chord length (centripetal, Lee 1989), which swings least between points of uneven spacing. It fails where it
strays, wiggles or bends too tightly.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.road.clothoid import MAX_CURVATURE, SPACING, Array, advance, fit, with_ends
from sidestep.plant_models.road.polyline import Polyline, strays
from sidestep.plant_models.road.smoothing import AIM, REACH, TOLERANCE, Mask, smoothed
from sidestep.plant_models.road.waypoints import WayPoints

Index = NDArray[np.intp]

_STEP = 0.25  # between smoothed positions, in [m]
_MARGIN = 30.0  # smoothed beside a place where the spline fails, in [m]
_LAP = 100.0  # of a closed road beyond its seam: that far nothing of the ends is felt, in [m]
_TIGHT = 0.2  # curvature that cars hardly drive: worth smoothing, in [1/m]
_CHUNK = 100_000  # chords or nodes at a time: memory stays bounded on long roads


@dataclass(frozen=True, eq=False)
class Fit:
    """A path along way-points.

    Attributes:
        table: Of the path, see `clothoid`.
        nodes: Arc length along the polyline at which each of its rows from 1 on belongs, ascending.
        notes: What was smoothed, and the largest deviation.
    """

    table: Array
    nodes: Array
    notes: tuple[str, ...]


def along(points: WayPoints, smooth: float | None = None) -> Fit:
    """The path along cleaned way-points.

    Args:
        points: As `WayPoints.cleaned` returns them.
        smooth: Distance by which the path may stray so as to be smooth everywhere, in [m]; None: through the points
            where a spline holds to their polyline within TOLERANCE, smoothed where not.

    Raises:
        InputError: With the place: the path would stray further, or bend more tightly than MAX_CURVATURE.
    """
    line, tolerance = points.line, TOLERANCE if smooth is None else smooth
    spline, knots, bad = _spline(line, tolerance)
    if smooth is not None:
        bad[:] = True
    if not bad.any():
        u, parameters, _ = _nodes(line, knots)
        table, smoothed = _table(spline, parameters, line.closed), 0.0
    else:
        u, positions, smoothed = _within_tube(line, spline, knots, bad, tolerance)
        through = CubicSpline(u, positions, bc_type="periodic" if line.closed else "not-a-knot")
        table = _table(through, u, line.closed)
    _check_bends(points, table, u, tolerance)
    stray, place = _worst(line, table, u)
    if stray > tolerance:
        i = int(np.clip(np.searchsorted(line.stations, place), 0, len(line.points) - 1))
        problem = f"the path would stray {stray:.2f} m from the way-points"
        raise InputError(points.place(i), problem, f"<= {tolerance:g} m, or a larger road.smooth")
    if not smoothed:
        return Fit(table, u, ())
    i = int(np.argmin(np.abs(line.stations - place)))
    note = (
        f"smoothed along {smoothed:.0f} of {line.length:.0f} m: the path strays from the way-points by up to "
        f"{stray:.3f} m, near {points.place(i)}"
    )
    return Fit(table, u, (note,))


def _spline(line: Polyline, tolerance: float) -> tuple[CubicSpline, Array, Mask]:
    """A spline through the points, its knots, and beside which chords it fails: the first of two that fails nowhere."""
    spline, knots, bad = None, line.stations, np.ones(len(line.points) - 1, bool)
    for exponent in (1.0, 0.5):
        knots = np.concatenate([[0.0], np.cumsum(np.diff(line.stations) ** exponent)])
        spline = CubicSpline(knots, line.points, bc_type="periodic" if line.closed else "not-a-knot")
        bad = _fails(line, spline, knots, tolerance)
        if not bad.any():
            break
    assert spline is not None
    return spline, knots, bad


def _nodes(
    line: Polyline, knots: Array, spacing: float = SPACING, part: slice = slice(None)
) -> tuple[Array, Array, Index]:
    """Arc length along the polyline, spline parameter and chord of nodes, each chord of a part in equal parts."""
    chords, steps = np.diff(line.stations)[part], np.diff(knots)[part]
    counts = np.ceil(chords / spacing).astype(np.int64)
    row = np.repeat(np.arange(len(chords)), counts)
    fraction = (np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[row]
    start, end = part.start or 0, (part.start or 0) + len(chords)
    u = np.append(line.stations[start + row] + fraction * chords[row], line.stations[end])
    return u, np.append(knots[start + row] + fraction * steps[row], knots[end]), np.append(row, row[-1])


def _fails(line: Polyline, spline: CubicSpline, knots: Array, tolerance: float) -> Mask:
    """Chords beside which the spline strays, bends too tightly, or wiggles: bends far more than the polyline does."""
    bad = np.zeros(len(line.points) - 1, bool)
    for start in range(0, len(bad), _CHUNK):
        part = slice(start, min(start + _CHUNK, len(bad)))
        u, parameters, chord = _nodes(line, knots, part=part)
        first, second = spline(parameters, 1), spline(parameters, 2)
        speed = np.maximum(np.hypot(*first.T), 1e-12)
        bend = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
        off = strays(line.points, line.stations, spline(parameters), u, REACH)[0] > tolerance * AIM
        wrong = off | ~(bend <= np.minimum(_allowed_bend(line, part), _TIGHT)[chord])
        bad[part] = np.bincount(chord[wrong], minlength=part.stop - start) > 0
    return bad


def _allowed_bend(line: Polyline, part: slice) -> Array:
    """Curvature that a spline may need beside some chords: thrice that of the polyline seen over some metres."""
    count = len(line.points) - 1
    at = np.arange(part.start - 1, part.stop + 2)  # a chord before and one after
    at = at % count if line.closed else np.clip(at, 0, count)
    u, points, chords = line.stations[at], line.points[at], np.diff(line.stations)
    behind, ahead = (at - 1) % count if line.closed else np.maximum(at - 1, 0), np.minimum(at, count - 1)
    reach = np.maximum(2.0, np.maximum(chords[behind], chords[ahead]))
    ahead, behind = line.on(u + reach) - points, points - line.on(u - reach)
    cross = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    bend = np.abs(np.arctan2(cross, (behind * ahead).sum(axis=1))) / reach
    return 3.0 * np.max([bend[:-3], bend[1:-2], bend[2:-1], bend[3:]], axis=0) + 0.02


def _within_tube(
    line: Polyline, spline: CubicSpline, knots: Array, bad: Mask, tolerance: float
) -> tuple[Array, Array, float]:
    """Arc lengths, evenly spaced, positions there, and the length that was smoothed."""
    count = max(4, math.ceil(line.length / _STEP))
    u = np.linspace(0.0, line.length, count + 1)
    positions = spline(_parameters(line, spline, knots, u))
    chord = np.minimum(np.searchsorted(line.stations, u, side="right") - 1, len(bad) - 1)
    step, margin = line.length / count, math.ceil(_MARGIN / (line.length / count))
    pad = min(count, math.ceil(_LAP / step)) if line.closed else 0
    index = np.arange(-pad, count + 1 + pad)
    on = index % count if line.closed else index
    loose = _dilated(bad[chord][on], margin)
    for start, end in _runs(loose):
        low, high = max(start - 4, 0), min(end + 4, len(index))
        part = on[low:high]
        pins = ~loose[low:high]
        if not line.closed:
            pins |= (part == 0) | (part == count)
        new = smoothed(
            line, np.multiply(index[low:high], step, dtype=np.float64), positions[part], pins, step, tolerance
        )
        inside = (index[low:high] >= 0) & (index[low:high] <= count) & loose[low:high]
        positions[index[low:high][inside]] = new[inside]
    if line.closed:
        positions[-1] = positions[0]
    return u, positions, float(np.count_nonzero(loose[pad : len(loose) - pad]) * step)


def _parameters(line: Polyline, spline: CubicSpline, knots: Array, u: Array) -> Array:
    """Parameters at which the spline passes the polyline's arc lengths u, as far as it keeps beside it."""
    near, parameters, _ = _nodes(line, knots, _STEP)
    feet = strays(line.points, line.stations, spline(parameters), near, REACH)[1]
    return np.interp(u, np.maximum.accumulate(feet), parameters)


def _dilated(mask: Mask, reach: int) -> Mask:
    edges = np.concatenate([[0], np.cumsum(mask)])
    i = np.arange(len(mask))
    return edges[np.minimum(i + reach + 1, len(mask))] > edges[np.maximum(i - reach, 0)]


def _runs(mask: Mask) -> list[tuple[int, int]]:
    change = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(start), int(end)) for start, end in change.reshape(-1, 2)]


def _table(spline: CubicSpline, parameters: Array, closed: bool) -> Array:
    """The path's table: positions and headings of the spline at the nodes, clothoids between them."""
    table = np.zeros((len(parameters) + 1, 6))
    for start in range(0, len(parameters), _CHUNK):
        part, rows = parameters[start : start + _CHUNK], table[start + 1 : start + 1 + _CHUNK]
        slope = spline(part, 1)
        rows[:, 1:3], rows[:, 3] = spline(part), np.arctan2(slope[:, 1], slope[:, 0])
    if closed:
        table[-1, 1:3] = table[1, 1:3]
    _join(table)
    table = with_ends(table, closed)
    table.flags.writeable = False
    return table


@kernel
def _join(table):
    """Arc lengths, continuous headings and clothoids between nodes whose positions and headings stand in the table."""
    for i in range(1, table.shape[0] - 1):
        dx, dy = table[i + 1, 1] - table[i, 1], table[i + 1, 2] - table[i, 2]
        chord, direction = math.sqrt(dx * dx + dy * dy), math.atan2(dy, dx)
        table[i + 1, 3] = table[i, 3] + _turn(table[i + 1, 3] - table[i, 3])
        start = _turn(table[i, 3] - direction)
        length, table[i, 4], table[i, 5] = fit(chord, start, _turn(table[i + 1, 3] - direction))
        table[i + 1, 0] = table[i, 0] + length


@kernel
def _turn(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def _check_bends(points: WayPoints, table: Array, u: Array, tolerance: float) -> None:
    curvature, sharpness, length = table[1:-1, 4], table[1:-1, 5], np.diff(table[1:, 0])
    bend = np.maximum(np.abs(curvature), np.abs(curvature + sharpness * length))
    tight = np.flatnonzero(~(bend <= MAX_CURVATURE))
    if len(tight) == 0:
        return
    i, line = int(tight[0]), points.line
    close = np.abs(line.stations - u[i]) <= REACH
    chord = int(np.clip(np.searchsorted(line.stations, u[i], side="right") - 1, 0, len(line.points) - 2))
    close[chord : chord + 2] = True
    vertex = int(np.argmax(np.where(close, np.abs(line.turns), -1.0)))
    radius = 1.0 / bend[i] if np.isfinite(bend[i]) else 0.0
    problem = (
        f"the way-points turn by {points.turn_at(vertex).partition(' at ')[0]} here: within {tolerance:g} m of them "
        f"the path bends to a radius of {radius:.2g} m"
    )
    raise InputError(points.place(vertex), problem, f">= {1.0 / MAX_CURVATURE:g} m, or a larger road.smooth")


def _worst(line: Polyline, table: Array, u: Array) -> tuple[float, float]:
    """Largest distance between path and polyline, either way, and where along the polyline, in [m]."""
    worst, place = 0.0, 0.0
    for start in range(0, len(u) - 1, _CHUNK):
        part = slice(start, start + _CHUNK + 1)
        nodes = u[part]
        samples, near = _halves(table[start + 1 : start + _CHUNK + 2]), np.empty(2 * len(nodes) - 1)
        near[::2], near[1::2] = nodes, 0.5 * (nodes[1:] + nodes[:-1])
        own = slice(*np.searchsorted(line.stations, nodes[[0, -1]]))
        off = strays(line.points, line.stations, samples, near, REACH)[0]
        missed = strays(samples, near, line.points[own], line.stations[own], REACH)[0]
        for distances, stations in ((off, near), (missed, line.stations[own])):
            if len(distances) and distances.max() > worst:
                worst, place = float(distances.max()), float(stations[np.argmax(distances)])
    return worst, place


@kernel
def _halves(rows):
    """Positions at the rows of a table and half-way between them, in order."""
    result = np.empty((2 * len(rows) - 1, 2))
    for i in range(len(rows)):
        result[2 * i] = rows[i, 1], rows[i, 2]
        if i + 1 < len(rows):
            heading, curvature, sharpness = rows[i, 3:]
            dx, dy = advance(heading, curvature, sharpness, 0.5 * (rows[i + 1, 0] - rows[i, 0]))
            result[2 * i + 1] = rows[i, 1] + dx, rows[i, 2] + dy
    return result
