"""What every record of a vehicle checks: its keys and its numbers; errors name table and key."""

import math
from dataclasses import MISSING, fields
from typing import Any

from sidestep.plant_models.errors import InputError

GRAVITY = 9.81
"""Acceleration of gravity used by every plant, in [m/s^2]."""


def built(cls: type, where: str, data: Any) -> Any:
    """The dataclass `cls` of a table.

    Raises:
        InputError: No table, an unknown or a missing key, or a value that `cls` refuses.
    """
    if not isinstance(data, dict):
        raise InputError(where, f"{data!r} is not a table", ", ".join(f.name for f in fields(cls)))
    for key in data:
        require_known(cls, where, key)
    missing = [f.name for f in fields(cls) if f.name not in data and _is_required(f)]
    if missing:
        raise InputError(where, f"missing {', '.join(missing)}")
    return cls(**data)


def require_known(cls: type, where: str, key: str) -> None:
    """Refuse a key that is no field of `cls`.

    Raises:
        InputError: With the fields.
    """
    names = [f.name for f in fields(cls)]
    if key not in names:
        raise InputError(f"{where}.{key}", "unknown key", ", ".join(names))


def require_positive(record: Any, where: str, or_zero: tuple[str, ...] = (), without: tuple[str, ...] = ()) -> None:
    """Refuse fields that are no finite numbers above zero; None is one that is not known.

    Args:
        record: A dataclass.
        where: Its table.
        or_zero: Fields that may be zero.
        without: Fields that are no numbers.

    Raises:
        InputError: With table and key.
    """
    for f in fields(record):
        value, allowed = getattr(record, f.name), ">= 0" if f.name in or_zero else "> 0"
        if f.name in without or (value is None and f.default is None):
            continue
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{where}.{f.name}", f"{value!r} is not a number", f"a number {allowed}")
        if not math.isfinite(value) or value < 0.0 or (value == 0.0 and f.name not in or_zero):
            raise InputError(f"{where}.{f.name}", f"{value}", allowed)


def _is_required(f: Any) -> bool:
    return f.default is MISSING and f.default_factory is MISSING
