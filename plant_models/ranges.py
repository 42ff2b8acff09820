"""Ranges of the numbers that files and options hold: generous, physical, and written at the field itself.

    mass: Annotated[float, Range(0.1, 1e6, "kg")]

`check(record, place)` in `__post_init__` holds a dataclass to them; readers of files use the same ranges.
"""

import functools
from dataclasses import fields
from typing import Any, NamedTuple, get_args

from sidestep.plant_models.errors import InputError


class Range(NamedTuple):
    """The numbers that a key takes, both ends included.

    Attributes:
        low, high: In the key's unit.
        unit: For errors and tables; empty for none.
    """

    low: float
    high: float
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()

    def check(self, value: Any, where: str, whole: bool = False) -> None:
        """Refuse what is no number of the range.

        Args:
            value: To be checked.
            where: Dotted key, for the error.
            whole: Whether it must be an integer.

        Raises:
            InputError: It is none.
        """
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
            raise InputError(where, f"{value!r}", f"a {'whole ' if whole else ''}number, {self}")
        if not self.low <= value <= self.high:  # nan neither
            raise InputError(where, f"{value}", str(self))


class Bounded(NamedTuple):
    """A field that has a range.

    Attributes:
        name: Of the field.
        range: What it takes.
        whole: Whether it is an integer.
        optional: Whether None stands for "not given".
    """

    name: str
    range: Range
    whole: bool
    optional: bool


@functools.cache
def bounded_fields(cls: type) -> tuple[Bounded, ...]:
    """The fields of a dataclass that have a range."""
    found = ((f.name, range_of(f.type), f.type) for f in fields(cls))
    return tuple(
        Bounded(name, limits, int in _parts(kind), type(None) in _parts(kind)) for name, limits, kind in found if limits
    )


def range_of(hint: Any) -> Range | None:
    """The range in a type annotation; None if it has none."""
    return next((part for part in _parts(hint) if isinstance(part, Range)), None)


def check(record: Any, place: str) -> None:
    """Hold a dataclass to the ranges of its fields.

    Args:
        record: The dataclass.
        place: Dotted key of its table, for the errors.

    Raises:
        InputError: With key, value and range.
    """
    for name, limits, whole, optional in bounded_fields(type(record)):
        value = getattr(record, name)
        if not (optional and value is None):
            limits.check(value, f"{place}.{name}", whole)


def _parts(hint: Any) -> list[Any]:
    """All that a type annotation is made of."""
    arguments = [*get_args(hint), *getattr(hint, "__metadata__", ())]
    return [hint, *(part for argument in arguments for part in _parts(argument))]
