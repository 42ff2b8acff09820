"""Variables that are set or read together: scalars and elements of arrays, of double and single precision."""

import ctypes
import re
from collections.abc import Callable
from math import prod
from typing import Any, NamedTuple

from fmpy.model_description import ScalarVariable

FLOATS: dict[str, Any] = {"Real": ctypes.c_double, "Float64": ctypes.c_double, "Float32": ctypes.c_float}
"""Types of a port's variables, and what holds them."""
_ELEMENT = re.compile(r"(.+)\[(\d+(?:\s*,\s*\d+)*)\]")


class Part(NamedTuple):
    """Variables of one type, which one call sets or reads.

    Attributes:
        set, get: The FMU's functions.
        set_name, get_name: Their names.
        arguments: Behind the instance.
        buffer: The values in the FMU's type; all elements of its arrays.
        places: Positions in the port and in the buffer; empty where the buffer is the port's own.
    """

    set: Callable[..., int]
    get: Callable[..., int]
    set_name: str
    get_name: str
    arguments: tuple[Any, ...]
    buffer: Any
    places: tuple[tuple[int, int], ...]


class Port:
    """Variables that are always set or read together, with the buffer of their values.

    Attributes:
        names: The variables.
        values: Their values, in the FMU's units; a ctypes array of doubles.
        parts: The calls that they take.
        is_plain: Whether it is one call with the port's own buffer: `set_plain` and `get_plain` with `arguments`.
    """

    def __init__(self, library: Any, names: list[str], rows: list[tuple[ScalarVariable, int]], is_fmi2: bool):
        self.names, self.values = names, (ctypes.c_double * len(names))()
        kinds = dict.fromkeys(str(variable.type) for variable, _ in rows)
        self.is_plain = all(FLOATS[kind] is ctypes.c_double for kind in kinds) and not any(v.shape for v, _ in rows)
        if self.is_plain:
            kind = "Real" if is_fmi2 else "Float64"
            references = [int(variable.valueReference) for variable, _ in rows]
            self.parts = [_part(library, kind, references, self.values, (), is_fmi2)]
        else:
            self.parts = [_mixed(library, kind, rows) for kind in kinds]
        self.set_plain, self.get_plain, self.arguments = self.parts[0].set, self.parts[0].get, self.parts[0].arguments


def find_element(variables: dict[str, ScalarVariable], name: str) -> tuple[ScalarVariable, int] | None:
    """The variable of a name and the place in it: `position[0]`, `matrix[1,2]`, from 0 on; a whole name comes first.

    Returns:
        None if there is no such variable or element, or it is an array without an element named.
    """
    if variable := variables.get(name):
        return None if variable.shape else (variable, 0)
    match = _ELEMENT.fullmatch(name)
    variable = variables.get(match[1]) if match else None
    if not match or variable is None or not variable.shape:
        return None
    index = [int(part) for part in match[2].split(",")]
    shape = variable.shape if len(index) > 1 else (prod(variable.shape),)
    if len(index) != len(shape) or any(i >= n for i, n in zip(index, shape, strict=True)):
        return None
    place = 0
    for i, n in zip(index, shape, strict=True):
        place = place * n + i
    return variable, place


def elements(variable: ScalarVariable) -> list[str]:
    """Names of all elements of a variable; its own if it is no array."""
    return [f"{variable.name}[{i}]" for i in range(prod(variable.shape))] if variable.shape else [str(variable.name)]


def _mixed(library: Any, kind: str, rows: list[tuple[ScalarVariable, int]]) -> Part:
    """All variables of one type in FMI 3.0; the elements of an array that nobody names keep their start values."""
    used = list({v.name: v for v, _ in rows if v.type == kind}.values())
    begins, size = {}, 0
    for variable in used:
        begins[variable.name], size = size, size + prod(variable.shape or ())
    buffer = (FLOATS[kind] * size)()
    for variable in used:
        starts = _starts(variable)
        buffer[begins[variable.name] : begins[variable.name] + len(starts)] = starts
    places = tuple((k, begins[v.name] + place) for k, (v, place) in enumerate(rows) if v.type == kind)
    return _part(library, kind, [int(v.valueReference) for v in used], buffer, places, is_fmi2=False)


def _starts(variable: ScalarVariable) -> list[float]:
    if variable.start is None:
        return []
    texts = variable.start if isinstance(variable.start, list) else str(variable.start).split()
    count = prod(variable.shape or ())
    return ([float(text) for text in texts] * (count if len(texts) == 1 else 1))[:count]


def _part(
    library: Any, kind: str, references: list[int], buffer: Any, places: tuple[tuple[int, int], ...], is_fmi2: bool
) -> Part:
    names = [f"fmi{2 if is_fmi2 else 3}{verb}{kind}" for verb in ("Set", "Get")]
    size = ctypes.c_size_t(len(references))
    arguments: tuple[Any, ...] = ((ctypes.c_uint32 * len(references))(*references), size, buffer)
    if not is_fmi2:
        arguments = (*arguments, ctypes.c_size_t(len(buffer)))
    functions = [library[name] for name in names]  # fresh ones without argument conversion: all are ctypes values
    return Part(functions[0], functions[1], names[0], names[1], arguments, buffer, places)
