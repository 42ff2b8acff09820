"""What every record of a vehicle checks: its keys; errors name table and key."""

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


def _is_required(f: Any) -> bool:
    return f.default is MISSING and f.default_factory is MISSING
