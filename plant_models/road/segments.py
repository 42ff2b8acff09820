"""Pieces that a road is made of: lines, arcs and clothoids."""

import math
from dataclasses import dataclass, fields

import numpy as np

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.clothoid import MAX_CURVATURE, MAX_LENGTH, SPACING, Array


@dataclass(frozen=True, slots=True)
class Line:
    """A straight piece of road.

    Attributes:
        length: In [m], up to 1e6.
    """

    length: float

    def __post_init__(self) -> None:
        _check_segment(self)


@dataclass(frozen=True, slots=True)
class Arc:
    """A circular piece of road.

    Attributes:
        length: In [m], up to 1e6.
        curvature: In [1/m], positive to the left, up to 1.
    """

    length: float
    curvature: float

    def __post_init__(self) -> None:
        _check_segment(self)


@dataclass(frozen=True, slots=True)
class Clothoid:
    """A piece of road whose curvature changes linearly with arc length.

    Attributes:
        length: In [m], up to 1e6.
        curvature_start, curvature_end: In [1/m], positive to the left, up to 1.
    """

    length: float
    curvature_start: float
    curvature_end: float

    def __post_init__(self) -> None:
        _check_segment(self)


Segment = Line | Arc | Clothoid


def _check_segment(segment: Segment) -> None:
    for f in fields(segment):
        value, where = getattr(segment, f.name), f"segment.{f.name}"
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(where, f"{value!r} is not a finite number")
        if f.name == "length" and not 0.0 < value <= MAX_LENGTH:
            raise InputError(where, f"{value} m", f"0 < length <= {MAX_LENGTH:g}")
        if f.name != "length" and abs(value) > MAX_CURVATURE:
            raise InputError(where, f"{value} 1/m", f"-{MAX_CURVATURE:g} <= curvature <= {MAX_CURVATURE:g}")


def split(segment: Segment, where: str) -> Array:
    """Length, curvature at the start and sharpness of the pieces of a segment, shape (n, 3).

    Raises:
        InputError: It is none; `where` names it.
    """
    match segment:
        case Line(length):
            start = end = 0.0
        case Arc(length, start):
            end = start
        case Clothoid(length, start, end):
            pass
        case _:
            raise InputError(where, f"{segment!r}", "Line, Arc, Clothoid")
    count = math.ceil(length / SPACING)
    sharpness = (end - start) / length
    curvature = start + sharpness * length / count * np.arange(count)
    return np.column_stack([np.full(count, length / count), curvature, np.full(count, sharpness)])
