"""Units of an FMU's variables: by name, by the factors of the file's unit definitions, by the suffix of a name."""

import re
from typing import NamedTuple

from fmpy.model_description import BaseUnit, ModelDescription, ScalarVariable

from sidestep.fmu.importing.mapping import UNITS

_SPELLINGS = {
    "°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad", "kph": "km/h", "kmh": "km/h",
    "kmph": "km/h", "km/hr": "km/h", "m.s-1": "m/s", "mps": "m/s", "rad.s-1": "rad/s", "rad/sec": "rad/s",
    "°/s": "deg/s", "deg.s-1": "deg/s", "deg/sec": "deg/s", "m/s^2": "m/s2", "m/s²": "m/s2", "m.s-2": "m/s2",
    "meter": "m", "metre": "m",
}  # fmt: skip
_SUFFIX = re.compile(
    r"_(deg|rad|km_?h|kmph|kph|mph|mps|m_s|deg_?ps|deg_s|dps|rad_?ps|rad_s|mm|km|m|mps2|m_s2)$", re.IGNORECASE
)
_SUFFIXES = {
    "deg": "deg", "rad": "rad", "kmh": "km/h", "kmph": "km/h", "kph": "km/h", "mph": "mph", "mps": "m/s", "ms": "m/s",
    "degps": "deg/s", "degs": "deg/s", "dps": "deg/s", "radps": "rad/s", "rads": "rad/s", "mm": "mm", "km": "km",
    "m": "m", "mps2": "m/s2", "ms2": "m/s2",
}  # fmt: skip
_EXPONENTS = {
    "length": ({"m": 1},), "angle": ({"rad": 1}, {}), "speed": ({"m": 1, "s": -1},),
    "angular rate": ({"rad": 1, "s": -1}, {"s": -1}), "acceleration": ({"m": 1, "s": -2},),
}  # fmt: skip
_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


class Scale(NamedTuple):
    """How a variable's values become SI: scale * value + offset.

    Attributes:
        unit: A unit that mapping files know, empty if `scale` and `offset` say it.
        scale, offset: From the file's own definition.
    """

    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0


def unit_of(variable: ScalarVariable) -> str:
    """Unit of a variable in our spelling; empty if it has none."""
    unit = variable.unit or getattr(variable.declaredType, "unit", None) or ""
    return _SPELLINGS.get(unit, unit)


def without_suffix(name: str) -> str:
    """A name without the unit at its end: Psi_deg, vx_kmh."""
    return _SUFFIX.sub("", name)


def scale_of(description: ModelDescription, variable: ScalarVariable, dimension: str) -> Scale | None:
    """How a variable becomes a signal of a dimension of `mapping.UNITS`; None if it is of another one."""
    unit, known = unit_of(variable), UNITS[dimension]
    defined = next((u.baseUnit for u in description.unitDefinitions or [] if u.name == (variable.unit or unit)), None)
    if not unit or unit == "1":
        suffix = _SUFFIX.search(str(variable.name))
        told = _SUFFIXES.get(suffix[1].lower().replace("_", ""), "") if suffix else ""
        return Scale(told) if told in known else None if told else Scale()
    if defined is not None and _has_exponents(defined):
        if not _is_of(defined, dimension):
            return None
        factor, offset = float(defined.factor), float(defined.offset)
        if unit in known and abs(factor / known[unit] - 1.0) < 1e-3:
            return Scale(unit)
        return Scale("", factor, offset)
    return Scale(unit) if unit in known else None


def _exponents(base: BaseUnit) -> dict[str, int]:
    return {name: int(value) for name in _BASES if (value := getattr(base, name))}


def _has_exponents(base: BaseUnit) -> bool:
    """Whether it says anything: many files name a base unit and leave it at that."""
    return bool(_exponents(base)) or float(base.factor) != 1.0


def _is_of(base: BaseUnit, dimension: str) -> bool:
    return _exponents(base) in _EXPONENTS[dimension]
