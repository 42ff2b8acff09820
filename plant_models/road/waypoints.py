"""Way-points to a path: reading them from a CSV file, and a cubic spline cut into clothoid pieces."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.clothoid import MAX_CURVATURE, MAX_LENGTH, SPACING, Array, fit, with_ends

_SAME_POINT = 1e-6  # [m]


def read_waypoints(path: str | Path) -> tuple[Array, list[str]]:
    """Columns x and y, in [m], of a CSV file separated by commas, semicolons or tabs.

    A header names the columns (`x`, `x_m` or `x [m]`; further ones are ignored), without one x and y come
    first. Lines that start with `#` are comments, or the header.

    Returns:
        Points, shape (N, 2), in [m], and `file:line` of each.

    Raises:
        InputError: With file and line.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"cannot be read ({error})") from error
    columns, points, names = None, [], []
    for number, line in enumerate(lines, start=1):
        where, cells = f"{path}:{number}", _cells(line)
        if line.startswith("#"):
            columns = columns or _named_columns(cells)
        elif columns is None and not _is_number(cells[0]) and line.strip():
            columns = _named_columns(cells)
            if columns is None:
                raise InputError(where, f"no columns x and y in the header {line.strip()!r}", "x, y")
        elif line.strip():
            columns = columns or (0, 1)
            points.append(_point(cells, columns, where))
            names.append(where)
    return np.array(points, dtype=np.float64).reshape(-1, 2), names


def _cells(line: str) -> list[str]:
    separator = next((mark for mark in ";\t" if mark in line), ",")
    return [cell.strip(' "') for cell in line.lstrip("# ").split(separator)]


def _named_columns(cells: list[str]) -> tuple[int, int] | None:
    names = [cell.lower().replace("_", " ").split(" ")[0] for cell in cells]
    return (names.index("x"), names.index("y")) if "x" in names and "y" in names else None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _point(cells: list[str], columns: tuple[int, int], where: str) -> tuple[float, float]:
    if len(cells) <= max(columns):
        raise InputError(where, f"only {len(cells)} columns", "x, y")
    for column in columns:
        if not _is_number(cells[column]):
            raise InputError(where, f"{cells[column]!r} is not a number")
    return float(cells[columns[0]]), float(cells[columns[1]])


def through_waypoints(points: Array, names: list[str], where: str, closed: bool | None = None) -> tuple[Array, bool]:
    """Table of the path through points, and whether it is closed.

    The spline only gives the nodes' positions and headings; the clothoid between two nodes meets both, so
    that curvature, heading and position of the path stay exact integrals of each other.

    Args:
        points: Shape (N, 2), in [m].
        names: What to call each of them in errors.
        where: What to call all of them.
        closed: None finds out by comparing the last with the first.

    Raises:
        InputError: Too few, repeated or non-finite points, or a bend tighter than MAX_CURVATURE.
    """
    points, closed = _checked(points, names, where, closed)
    chords = np.hypot(*np.diff(points, axis=0).T)
    nodes, headings, before = _spline_nodes(points, chords, closed)
    table = _fitted(nodes, headings)
    curvature, sharpness, length = table[1:-1, 4], table[1:-1, 5], np.diff(table[1:, 0])
    bend = np.maximum(np.abs(curvature), np.abs(curvature + sharpness * length))
    for i in np.flatnonzero(~(bend <= MAX_CURVATURE)).tolist():
        raise InputError(names[before[i]], f"the path bends to a radius of {1.0 / bend[i]:.2g} m after it", ">= 1 m")
    return with_ends(table, closed), closed


def _checked(points: Array, names: list[str], where: str, closed: bool | None) -> tuple[Array, bool]:
    """The points, on a closed path with the first one again at the end, and whether it is closed."""
    for i in np.flatnonzero(~np.isfinite(points).all(axis=1)).tolist():
        raise InputError(names[i], f"({points[i, 0]}, {points[i, 1]}) is not finite")
    returns = len(points) > 2 and math.dist(points[0], points[-1]) < _SAME_POINT
    if closed is None:
        closed = returns
    if closed:
        points = np.vstack([points[:-1] if returns else points, points[:1]])
    if len(points) < (4 if closed else 2):
        raise InputError(where, f"{len(points) - closed} points", "at least 2, or 3 different ones on a closed path")
    steps = np.hypot(*np.diff(points, axis=0).T)
    for i in np.flatnonzero(steps < _SAME_POINT).tolist():
        repeated = names[(i + 1) % len(names)]
        raise InputError(repeated, f"({points[i, 0]}, {points[i, 1]}) repeats the way-point before it")
    if steps.sum() > MAX_LENGTH:
        raise InputError(where, f"{steps.sum():.3g} m long", f"<= {MAX_LENGTH:g} m")
    return points, closed


def _spline_nodes(points: Array, chords: Array, closed: bool) -> tuple[Array, Array, NDArray[np.intp]]:
    """Nodes (n + 1, 2), their headings, and the way-point before each of the n pieces."""
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    spline = CubicSpline(knots, points, bc_type="periodic" if closed else "not-a-knot")
    counts = np.ceil(chords / SPACING).astype(int)
    interval = np.repeat(np.arange(len(chords)), counts)
    fraction = np.concatenate([np.arange(count) / count for count in counts])
    u = np.append(knots[interval] + fraction * chords[interval], knots[-1])
    slope = spline(u, 1)
    return spline(u), np.unwrap(np.arctan2(slope[:, 1], slope[:, 0])), interval


def _fitted(nodes: Array, headings: Array) -> Array:
    steps = np.diff(nodes, axis=0)
    chords, directions = np.hypot(steps[:, 0], steps[:, 1]), np.arctan2(steps[:, 1], steps[:, 0])
    turns = [np.remainder(ends - directions + math.pi, math.tau) - math.pi for ends in (headings[:-1], headings[1:])]
    pieces = np.array([fit(*piece) for piece in zip(chords, *turns, strict=True)])
    table = np.zeros((len(pieces) + 2, 6))
    table[1:, 0] = np.concatenate([[0.0], np.cumsum(pieces[:, 0])])
    table[1:, 1:3], table[1:, 3], table[1:-1, 4:] = nodes, headings, pieces[:, 1:]
    return table
