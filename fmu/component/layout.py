"""C structs from numpy dtypes: the header that users include, and the one behind it."""

import string
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from sidestep.controller.config import ControllerConfig
from sidestep.controller.memory import VERSION
from sidestep.controller.records import COMMAND, MEMORY, OBSTACLES, PLAN, SETTINGS, STATE, WORK
from sidestep.fmu.component.records import BOX_FIELDS, OBSTACLE, PARAMETER_FIELDS, PARAMETERS, SETUP, abi
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.ranges import bounded_fields

SOURCES = Path(__file__).parent / "sources"
_C_TYPES = {"f8": "double", "i8": "int64_t", "b1": "uint8_t"}
PUBLIC = {"state": STATE, "obstacle": OBSTACLE, "command": COMMAND, "plan": PLAN, "parameters": PARAMETERS}
"""Structs of sidestep.h by name, without `sidestep_` before it."""
_PRIVATE = {"memory": MEMORY, "settings": SETTINGS, "work": WORK, "setup": SETUP}


def header() -> str:
    """sidestep.h: types and functions of the C interface."""
    return _template("sidestep.h").substitute(
        abi=f"0x{abi():08x}u", version=version("sidestep"), obstacles=OBSTACLES, structs=_structs(PUBLIC, {}),
    )  # fmt: skip


def private_header() -> str:
    """layout.h: the records behind it, and the numbers that Python and C share."""
    known = {dtype: f"sidestep_{name}" for name, dtype in PUBLIC.items()}
    cruise = PARAMETER_FIELDS.index("cruise_speed")
    return (
        "/* Generated: do not edit. */\n#ifndef SIDESTEP_LAYOUT_H\n#define SIDESTEP_LAYOUT_H\n"
        f'#include "sidestep.h"\nenum {{ MEMORY_VERSION = {VERSION}, BOX_FIELDS = {len(BOX_FIELDS)}, '
        f"CRUISE_SPEED = {cruise} }};\n"
        f"static const double BOX_BOUNDS[][2] = {_bounds(Obstacle, BOX_FIELDS)};\n"
        f"static const double PARAMETER_BOUNDS[][2] = {_bounds(ControllerConfig, PARAMETER_FIELDS)};\n"
        f"{_structs(_PRIVATE, known)}"
        f"{_sizes(PUBLIC | _PRIVATE)}#endif\n"
    )


def _bounds(cls: type, names: Sequence[str]) -> str:
    """The ranges of a dataclass's fields as an initialiser."""
    limits = {field.name: field.range for field in bounded_fields(cls)}
    rows = "".join(f"    {{{limits[name].low!r}, {limits[name].high!r}}}, /* {name} */\n" for name in names)
    return f"{{\n{rows}}}"


def _template(name: str) -> string.Template:
    return string.Template((SOURCES / name).read_text(encoding="utf-8"))


def _structs(named: dict[str, np.dtype], known: dict[np.dtype, str]) -> str:
    text, known = "", dict(known)
    for name, dtype in named.items():
        text += f"typedef struct {{\n{_fields(dtype, known, 1)}}} sidestep_{name};\n\n"
        known[dtype] = f"sidestep_{name}"
    return text


def _fields(dtype: np.dtype, known: dict[np.dtype, str], depth: int) -> str:
    indent, lines = "    " * depth, ""
    for name in dtype.names or ():
        field = dtype[name]
        shape = "".join(f"[{n}]" for n in field.shape)
        lines += f"{indent}{_c_type(field.base, known, depth)} {name}{shape};\n"
    return lines


def _c_type(dtype: np.dtype, known: dict[np.dtype, str], depth: int) -> str:
    if dtype in known:
        return known[dtype]
    if dtype.names:
        return f"struct {{\n{_fields(dtype, known, depth + 1)}{'    ' * depth}}}"
    return _C_TYPES[dtype.str[1:]]


def _sizes(named: dict[str, np.dtype]) -> str:
    """Lines that do not compile where C lays a struct out otherwise than numpy."""
    return "".join(
        f"typedef char size_of_{name}[sizeof(sidestep_{name}) == {dtype.itemsize} ? 1 : -1];\n"
        for name, dtype in named.items()
    )
