"""Units that logs come in, and their factors to SI."""

import math
import re

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import GRAVITY

_DEGREE = math.pi / 180.0
KINDS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "angle": {"rad": 1.0, "deg": _DEGREE, "°": _DEGREE, "degree": _DEGREE, "degrees": _DEGREE, "mrad": 1e-3},
    "rate": {
        "rad/s": 1.0, "rad/sec": 1.0, "rps": 1.0, "deg/s": _DEGREE, "deg/sec": _DEGREE, "°/s": _DEGREE,
        "degree/s": _DEGREE, "dps": _DEGREE,
    },
    "speed": {
        "m/s": 1.0, "mps": 1.0, "km/h": 1 / 3.6, "kph": 1 / 3.6, "kmph": 1 / 3.6, "kmh": 1 / 3.6, "mph": 0.44704,
    },
    "acceleration": {"m/s2": 1.0, "m/ss": 1.0, "mps2": 1.0, "g": GRAVITY, "mg": 1e-3 * GRAVITY},
    "length": {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1e3},
}  # fmt: skip
"""Factor to SI by unit, per kind of quantity."""


def factor(kind: str, unit: str, where: str) -> float:
    """Factor from a unit to SI.

    Args:
        kind: One of KINDS.
        unit: As a header or a database writes it; empty for SI.
        where: File and signal, for the error.

    Raises:
        InputError: No such unit of this kind.
    """
    word = re.sub(r"[\s^*()]", "", unit.strip().lower()).replace("²", "2").replace("**", "")
    if not word:
        return 1.0
    if word not in KINDS[kind]:
        raise InputError(where, f"{unit!r} is no unit of {kind} known here", ", ".join(KINDS[kind]))
    return KINDS[kind][word]


def split_unit(head: str) -> tuple[str, str]:
    """Name and unit of a column's head: `yaw_rate [deg/s]`, `yaw_rate(deg/s)`, or a name alone."""
    match = re.fullmatch(r"\s*#?\s*(.*?)\s*[\[(]([^\])]*)[\])]\s*", head)
    return (match[1], match[2]) if match else (head.strip().lstrip("#").strip(), "")
