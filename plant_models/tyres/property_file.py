"""Reader of tyre property files (.tir, TNO): MF-Tyre 5.0 to 5.2 and PAC2002, Magic Formula 6.0 to 6.2.

The files use ISO axes with a slip angle of the opposite sign to ours, so that PKY1 is negative in them. What MF-Tyre
5.2 has otherwise than 6.1 is written in 6.1's coefficients: there camber shifts the curve (PHY3) where it stiffens it
in 6.1 (PKY6), and relaxation lengths are coefficients (PTX1, PTY1) where they follow from the carcass in 6.1.
"""

import math
from pathlib import Path
from typing import NamedTuple

from sidestep.plant_models.documents import file_bytes
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.tyres.formula import cornering_stiffness
from sidestep.plant_models.tyres.parameters import TYRE, TyreParameters
from sidestep.plant_models.tyres.property_scaling import (
    FACTORS,
    PRESSURE,
    SYNONYMS,
    WITHOUT_EFFECT,
    inflated,
    scaled,
)

LAWS = {"5": "5.2", "6": "5.2", "51": "5.2", "52": "5.2", "60": "6.1", "61": "6.1", "62": "6.1"}
"""The law that each FITTYP is read as."""

_TEXT = {
    "LENGTH": ("meter", "metre", "m"),
    "FORCE": ("newton", "n"),
    "ANGLE": ("radians", "radian", "rad"),
    "TYRESIDE": ("left", "right", "symmetric", "unknown"),
    "FITTYP": tuple(LAWS),
}
"""Values that can be used, lower case, of keys that change the meaning of the others."""

_NEEDED = ("UNLOADED_RADIUS", "FNOMIN", "PCY1", "PDY1", "PKY1", "PKY2")
_LONGITUDINAL = ("p_cx1", "p_dx1", "p_kx1")
_MOTORCYCLE = "PCY2"
_NAMES = {"nominal_load": "FNOMIN", "radius": "UNLOADED_RADIUS"}
_KEYS = {name: _NAMES.get(name, name.replace("_", "").upper()) for name in TYRE.names or ()}
_OTHER_SLIP_SIGN = (
    "p_ky1", "p_hy1", "p_hy2", "p_hy3", "p_ey3", "p_ey4", "r_hx1", "r_by3", "q_bz10", "q_ez4", "q_ez5",
    "q_hz1", "q_hz2", "q_hz3", "q_hz4",
)  # fmt: skip
_WITH_PEAK = ("p_dy1", "p_dy2", "q_bz10", "r_vy1", "r_vy2", "r_vy3")
_ONLY_6 = ("p_ky4", "p_ky5", "p_ky6", "p_ky7", "p_ey5", "r_bx3", "r_by4")
_CARCASS = {"x": "LONGITUDINAL_STIFFNESS", "y": "LATERAL_STIFFNESS"}
_TOLD = {"5.2": ("PTX1", "PTY1", "PTY2"), "6.1": tuple(_CARCASS.values())}
_INFLUENCES = {key.lstrip("-") for linear, squared, _ in PRESSURE.values() for key in (linear, squared) if key}
_WORDY = ("", "UNITS", "MDI_HEADER", "MODEL", "GOODYEAR")
_SWITCHES = {*_TEXT, "INFLPRES", "NOMPRES"}


class _Entry(NamedTuple):
    where: str  # file, line and key, for errors
    section: str
    text: str


_Entries = dict[str, _Entry]


class TyreFile(NamedTuple):
    """A property file as it was read.

    Attributes:
        tyre: Its coefficients, of a tyre on the left side; those that the file does not give are 0.
        law: "5.2" or "6.1".
        unused: Keys that change nothing here: what the law, as we have it, knows nothing of.
        filled: What the file lacks and was taken from the default tyre, in words; empty for nothing.
    """

    tyre: TyreParameters
    law: str
    unused: tuple[str, ...]
    filled: str


def read_tyre(path: str | Path) -> TyreParameters:
    """The tyre of a .tir file; see `read_tyre_file`."""
    return read_tyre_file(path).tyre


def read_tyre_file(path: str | Path) -> TyreFile:
    """Read a .tir file; scaling factors and inflation pressure go into the coefficients.

    Raises:
        InputError: With file, line and key: not readable, no tyre of a car, other units or axes, a coefficient
            that the law cannot take, or a value that is no number.
    """
    entries = _entries(path)
    law = _law(path, entries)
    _require_plain(entries)
    numbers = {name: _number(entries[key]) for name, key in _KEYS.items() if key in entries}
    if law == "5.2":
        numbers = {name: value for name, value in numbers.items() if name not in _ONLY_6}
    else:
        numbers.pop("p_hy3", None)
    if numbers["p_ky1"] >= 0.0:
        raise InputError(entries["PKY1"].where, f"{numbers['p_ky1']}: not in ISO axes", "< 0")
    for name in _OTHER_SLIP_SIGN:
        numbers[name] = -numbers.get(name, 0.0)
    if numbers["p_dy1"] < 0.0:  # MF_05: a negative peak on a rising curve is the same curve
        numbers |= {name: -numbers[name] for name in _WITH_PEAK if name in numbers}
    absent = dict.fromkeys((name for name in _KEYS if name[:2] in ("p_", "r_", "q_", "s_")), 0.0) | {"p_ky4": 2.0}
    filled = _filled_in(numbers)
    values = _influenced({**absent, **numbers}, entries)
    if law == "5.2":
        values |= {"p_ky6": values["p_vy3"], "p_ky7": values["p_vy4"]}  # camber then shifts by p_hy3 alone
    try:
        tyre = TyreParameters(**{**values, **_relaxation(values, entries, law)})
    except InputError as error:
        name = error.where.rpartition(".")[2]
        where = entries[_KEYS[name]].where if _KEYS.get(name) in entries else str(path)
        raise InputError(where, error.problem, error.allowed) from error
    is_right = "TYRESIDE" in entries and entries["TYRESIDE"].text.lower() == "right"
    words = "longitudinal slip: the file has none, the default tyre's" if filled else ""
    return TyreFile(tyre.mirrored() if is_right else tyre, law, _unused(entries, law, bool(filled)), words)


def _entries(path: str | Path) -> _Entries:
    """Every `KEY = value`; `!` and `$` start comments."""
    lines = file_bytes(path, "a tyre property file").decode("latin-1").splitlines()
    result, section = {}, ""
    for number, line in enumerate(lines, 1):
        content = line.partition("$")[0].partition("!")[0].strip()
        key, separator, value = content.partition("=")
        if separator and value.strip():
            where = f"{path}, line {number}, {key.strip()}"
            result[key.strip().upper()] = _Entry(where, section, value.strip().strip("'\""))
        elif content.startswith("["):
            section = content.strip("[] ").upper()
    return result


def _law(path: str | Path, entries: _Entries) -> str:
    """By FITTYP; of files without one (PAC2002, MF_05) by the coefficients that only one law has."""
    for key in _NEEDED:
        if key not in entries:
            raise InputError(str(path), f"no {key}", "a tyre property file of the Magic Formula, 5.0 to 6.2")
    if _MOTORCYCLE in entries:
        raise InputError(entries[_MOTORCYCLE].where, "a motorcycle tyre", "a tyre of a car")
    if "FITTYP" in entries:
        _require_word("FITTYP", entries["FITTYP"])
        return LAWS[entries["FITTYP"].text]
    is_6 = any(_KEYS[name] in entries for name in ("p_ky4", "p_ky6")) and "PHY3" not in entries
    return "6.1" if is_6 else "5.2"


def _require_plain(entries: _Entries) -> None:
    """Refuse what would change the meaning of the coefficients."""
    for key in _TEXT:
        if key in entries:
            _require_word(key, entries[key])
    for key, entry in entries.items():
        known = SYNONYMS.get(key, key) in FACTORS or key in WITHOUT_EFFECT
        if entry.section == "SCALING_COEFFICIENTS" and not known and _number(entry) != 1.0:
            raise InputError(entry.where, f"{entry.text}: an unknown scaling factor", "1")


def _require_word(key: str, entry: _Entry) -> None:
    if entry.text.lower() not in _TEXT[key]:
        raise InputError(entry.where, f"{entry.text!r}", ", ".join(_TEXT[key]))


def _number(entry: _Entry) -> float:
    try:
        value = float(entry.text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(entry.where, f"{entry.text!r} is not a number")
    return value


def _filled_in(numbers: dict[str, float]) -> tuple[str, ...]:
    """Let the default tyre fill in longitudinal slip where the file was fitted to lateral slip alone."""
    if all(numbers.get(name, 0.0) > 0.0 for name in _LONGITUDINAL):
        return ()
    default = TyreParameters()
    names = tuple(name for name in _KEYS if name.startswith(("p_cx", "p_dx", "p_ex", "p_kx", "p_hx", "p_vx", "r_")))
    numbers |= {name: getattr(default, name) for name in names}
    return names


def _influenced(numbers: dict[str, float], entries: _Entries) -> dict[str, float]:
    factors = {SYNONYMS.get(key, key): _number(entry) for key, entry in entries.items()
               if SYNONYMS.get(key, key) in FACTORS}  # fmt: skip
    if "INFLPRES" in entries and "NOMPRES" in entries:
        nominal = _number(entries["NOMPRES"])
        if nominal <= 0.0:
            raise InputError(entries["NOMPRES"].where, f"{nominal}", "> 0")
        influence = {key: _number(entries[key]) for key in _INFLUENCES if key in entries}
        numbers = inflated(numbers, influence, (_number(entries["INFLPRES"]) - nominal) / nominal)
    return scaled(numbers, factors)


def _relaxation(numbers: dict[str, float], entries: _Entries, law: str) -> dict[str, float]:
    """Relaxation lengths at the nominal load, in [m]; those that the file does not tell are the default's."""
    told = {key: _number(entries[key]) for key in _TOLD[law] if key in entries}
    factors = {axis: _number(entries[key]) if key in entries else 1.0 for axis, key in (("x", "LSGKP"), ("y", "LSGAL"))}
    if law == "5.2":
        peak, knee = told.get("PTY1", 0.0), told.get("PTY2", 0.0)
        share = math.sin(2.0 * math.atan(1.0 / knee)) if knee > 0.0 else 0.0
        lengths = {"x": told.get("PTX1", 0.0) * numbers["radius"], "y": peak * share * numbers["radius"]}
    else:
        tyre = TyreParameters(**numbers)
        slip = {
            "x": tyre.p_kx1 * tyre.nominal_load,
            "y": float(cornering_stiffness(tyre.nominal_load, tyre.as_array())),
        }
        lengths = {axis: slip[axis] / told[key] for axis, key in _CARCASS.items() if told.get(key, 0.0) > 0.0}
    return {f"relaxation_{axis}": factors[axis] * length for axis, length in lengths.items() if length > 0.0}


def _unused(entries: _Entries, law: str, filled: bool) -> tuple[str, ...]:
    """Keys that had no part in the result, without those of the head and the model, which are words and switches."""
    names = [
        name for name in _KEYS if not (law == "5.2" and name in _ONLY_6) and not (law == "6.1" and name == "p_hy3")
    ]
    used = {_KEYS[name] for name in names} | {*_TOLD[law], *_SWITCHES}
    if filled:
        used -= {
            _KEYS[name] for name in names if name[:3] in ("p_c", "p_d", "p_e", "p_k", "p_h", "p_v") and name[3] == "x"
        }
        used -= {_KEYS[name] for name in names if name.startswith("r_")}
    if "INFLPRES" in entries and "NOMPRES" in entries:
        used |= _INFLUENCES
    return tuple(
        key for key, entry in entries.items()
        if key not in used and SYNONYMS.get(key, key) not in FACTORS and entry.section not in _WORDY
    )  # fmt: skip
