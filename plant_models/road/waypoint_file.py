"""Way-points in a CSV file: x, y and, if it has them, the widths to both sides."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.waypoints import WayPoints

_SIDES = ({"w left", "w tr left", "width left"}, {"w right", "w tr right", "width right"})

_FARTHEST = 1e9  # m


@dataclass(frozen=True)
class _Layout:
    """Where a file's numbers begin and which of its columns are x, y and, if there, left and right."""

    skip: int
    separator: str
    columns: tuple[int, ...]


def read_waypoints(path: str | Path, closed: bool | None = None) -> WayPoints:
    """Columns x and y, in [m], of a CSV file separated by commas, semicolons or tabs, and widths if it has them.

    A header names the columns (`x`, `x_m` or `x [m]`; `w_left` and `w_right`, also as `w_tr_left_m` or `width_left`;
    further ones are ignored), without one x and y come first. Lines that start with `#` are comments, or the header.

    Args:
        path: The file.
        closed: Whether its last point joins the first; None for what the points say.

    Raises:
        InputError: With file and line.
    """
    file = Path(path)
    try:
        layout = _layout(file)
        values = _values(file, layout)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"cannot be read ({error})") from error
    if values is None:
        raise _first_fault(file, layout)
    if len(far := np.flatnonzero(~(np.abs(values) <= _FARTHEST).all(axis=1))):
        where = f"{path}:{_line_of(file, layout, int(far[0]))}"
        raise InputError(where, "a value that is not finite or too large", f"up to {_FARTHEST:g} m")
    sides = (values[:, 2], values[:, 3]) if values.shape[1] == 4 else (None, None)
    return WayPoints(values[:, :2], lambda i: f"{path}:{_line_of(file, layout, i)}", str(path), *sides, closed)


def _layout(file: Path) -> _Layout:
    columns: tuple[int, ...] | None = None
    number = 0
    with open(file, encoding="utf-8-sig") as stream:
        for number, line in enumerate(stream, start=1):
            cells = _cells(line, _separator(line))
            if line.startswith("#"):
                columns = columns or _named_columns(cells)
            elif columns is None and not _is_number(cells[0]) and line.strip():
                columns = _named_columns(cells)
                if columns is None:
                    raise InputError(f"{file}:{number}", f"no columns x and y in the header {line.strip()!r}", "x, y")
            elif line.strip():
                return _Layout(number - 1, _separator(line), columns or (0, 1))
    return _Layout(number, ",", columns or (0, 1))


def _values(file: Path, layout: _Layout) -> np.ndarray | None:
    """The columns, shape (n, 2 or 4); None if a line cannot be understood."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without data: told where points are counted
            values = np.loadtxt(
                file, delimiter=layout.separator, usecols=layout.columns, skiprows=layout.skip, comments="#",
                quotechar='"', encoding="utf-8-sig", ndmin=2,
            )  # fmt: skip
    except UnicodeDecodeError:
        raise
    except (ValueError, IndexError):
        return None
    return values.reshape(-1, len(layout.columns))


def _first_fault(file: Path, layout: _Layout) -> InputError:
    for number, cells in _rows(file, layout):
        where = f"{file}:{number}"
        if len(cells) <= max(layout.columns):
            return InputError(where, f"only {len(cells)} columns", "x, y" + ", widths" * (len(layout.columns) > 2))
        for column in layout.columns:
            if not _is_number(cells[column]):
                return InputError(where, f"{cells[column]!r} is not a number")
    return InputError(str(file), "no table of numbers", "x, y")


def _rows(file: Path, layout: _Layout) -> Iterator[tuple[int, list[str]]]:
    with open(file, encoding="utf-8-sig") as stream:
        for number, line in enumerate(stream, start=1):
            if number > layout.skip and line.strip() and not line.startswith("#"):
                yield number, _cells(line, layout.separator)


def _line_of(file: Path, layout: _Layout, index: int) -> int:
    return next((number for i, (number, _) in enumerate(_rows(file, layout)) if i == index), 0)


def _separator(line: str) -> str:
    return next((mark for mark in ";\t" if mark in line), ",")


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip(' "\n\r') for cell in line.lstrip("# ").split(separator)]


def _named_columns(cells: list[str]) -> tuple[int, ...] | None:
    names = [" ".join(cell.lower().partition("[")[0].replace("_", " ").split()) for cell in cells]
    bare = [name.removesuffix(" m") for name in names]
    if "x" not in bare or "y" not in bare:
        return None
    sides = [next((i for i, name in enumerate(bare) if name in side), None) for side in _SIDES]
    return (bare.index("x"), bare.index("y"), *(i for i in sides if i is not None and None not in sides))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
