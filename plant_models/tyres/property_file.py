"""Reader of tyre property files (.tir, TNO): Magic Formula 6.1, or 6.2 at its nominal pressure.

The files use ISO axes with a slip angle of the opposite sign to ours, so that PKY1 is negative in them.
Turn slip, rolling resistance and overturning moment are not read.
"""

import math
from pathlib import Path
from typing import NamedTuple

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.tyres.formula import cornering_stiffness
from sidestep.plant_models.tyres.parameters import TYRE, TyreParameters

_TEXT = {
    "LENGTH": ("meter", "m"),
    "FORCE": ("newton", "n"),
    "ANGLE": ("radians", "radian", "rad"),
    "TYRESIDE": ("left", "right", "symmetric", "unknown"),
    "FITTYP": ("61", "62"),
}
"""Values that can be used, lower case, of keys that change the meaning of the others."""

_NEEDED = ("FITTYP", "UNLOADED_RADIUS", "FNOMIN", "PCX1", "PDX1", "PKX1", "PCY1", "PDY1", "PKY1", "PKY2")
_NAMES = {"nominal_load": "FNOMIN", "radius": "UNLOADED_RADIUS"}
_KEYS = {name: _NAMES.get(name, name.replace("_", "").upper()) for name in TYRE.names or ()}
_OTHER_SLIP_SIGN = (
    "p_ky1", "p_hy1", "p_hy2", "p_ey3", "p_ey4", "r_hx1", "r_by3", "q_bz10", "q_ez4", "q_ez5",
    "q_hz1", "q_hz2", "q_hz3", "q_hz4",
)  # fmt: skip


class _Entry(NamedTuple):
    where: str  # file, line and key, for errors
    section: str
    text: str


def read_tyre(path: str | Path) -> TyreParameters:
    """Read a .tir file; coefficients that it does not give are 0.

    Relaxation lengths follow from the carcass stiffnesses where the file has them.

    Raises:
        InputError: With file, line and key: not readable, not 6.1, other units or axes, scaled, or a value
            that is no number.
    """
    entries = _entries(path)
    for key in _NEEDED:
        if key not in entries:
            raise InputError(str(path), f"no {key}", "a TNO property file of FITTYP 61 or 62")
    for key, entry in entries.items():
        _require_plain(key, entry, entries)
    numbers = {name: _number(entries[key]) for name, key in _KEYS.items() if key in entries}
    if numbers["p_ky1"] >= 0.0:
        raise InputError(entries["PKY1"].where, f"{numbers['p_ky1']}: not in ISO axes", "< 0")
    for name in _OTHER_SLIP_SIGN:
        numbers[name] = -numbers.get(name, 0.0)
    absent = dict.fromkeys((name for name in _KEYS if name[:2] in ("p_", "r_", "q_", "s_")), 0.0) | {"p_ky4": 2.0}
    try:
        tyre = TyreParameters(**{**absent, **numbers, **_relaxation({**absent, **numbers}, entries)})
    except InputError as error:
        name = error.where.rpartition(".")[2]
        where = entries[_KEYS[name]].where if _KEYS[name] in entries else str(path)
        raise InputError(where, error.problem, error.allowed) from error
    is_right = "TYRESIDE" in entries and entries["TYRESIDE"].text.lower() == "right"
    return tyre.mirrored() if is_right else tyre


def _entries(path: str | Path) -> dict[str, _Entry]:
    """Every `KEY = value`; `!` and `$` start comments."""
    try:
        lines = Path(path).read_text(encoding="latin-1").splitlines()
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error)) from error
    result, section = {}, ""
    for number, line in enumerate(lines, 1):
        content = line.partition("$")[0].partition("!")[0].strip()
        key, separator, value = content.partition("=")
        if separator:
            where = f"{path}, line {number}, {key.strip()}"
            result[key.strip().upper()] = _Entry(where, section, value.strip().strip("'\""))
        elif content.startswith("["):
            section = content.strip("[] ").upper()
    return result


def _require_plain(key: str, entry: _Entry, entries: dict[str, _Entry]) -> None:
    """Refuse what would change the meaning of the coefficients."""
    allowed = _TEXT.get(key, ())
    if allowed and entry.text.lower() not in allowed:
        raise InputError(entry.where, f"{entry.text!r}", ", ".join(allowed))
    if entry.section == "SCALING_COEFFICIENTS" and key != "LMUV" and _number(entry) != 1.0:
        raise InputError(
            entry.where, f"{entry.text}: scaling factors are not applied", "1; scale the coefficients instead"
        )
    if key == "INFLPRES" and "NOMPRES" in entries and _number(entry) != _number(entries["NOMPRES"]):
        raise InputError(entry.where, f"{entry.text} is not the nominal pressure", entries["NOMPRES"].text)


def _number(entry: _Entry) -> float:
    try:
        value = float(entry.text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(entry.where, f"{entry.text!r} is not a number")
    return value


def _relaxation(numbers: dict[str, float], entries: dict[str, _Entry]) -> dict[str, float]:
    """Slip stiffness over carcass stiffness at the nominal load, in [m]."""
    tyre, result = TyreParameters(**numbers), {}
    slip_x, slip_y = tyre.p_kx1 * tyre.nominal_load, cornering_stiffness(tyre.nominal_load, tyre.as_array())
    for axis, key, slip in (("x", "LONGITUDINAL_STIFFNESS", slip_x), ("y", "LATERAL_STIFFNESS", slip_y)):
        if key in entries and _number(entries[key]) > 0.0:
            result[f"relaxation_{axis}"] = float(slip) / _number(entries[key])
    return result
