"""The one variable table of each FMU that we make; C header and both XML files are made from it.

A variable's value reference is its place in the table, assigned nowhere else. The C core keeps all
values in one flat array in that order, so that a value reference also is an array index.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sidestep.plant_models.vehicle.parameters import GRAVITY

Kind = Literal[
    "time", "input", "state", "hidden state", "derivative", "output", "sampled", "tunable", "fixed", "constant"
]

ATTRIBUTES: dict[Kind, tuple[str, str, str | None]] = {
    "time": ("independent", "continuous", None),
    "input": ("input", "continuous", None),
    "state": ("output", "continuous", "calculated"),
    "hidden state": ("local", "continuous", "calculated"),
    "derivative": ("local", "continuous", "calculated"),
    "output": ("output", "continuous", "calculated"),
    "sampled": ("output", "discrete", "calculated"),
    "tunable": ("parameter", "tunable", "exact"),
    "fixed": ("parameter", "fixed", "exact"),
    "constant": ("local", "constant", "exact"),
}
"""FMI causality, variability and initial of each kind."""

MOTION = (
    ("x", "m", "Position of the reference point in the world"),
    ("y", "m", "Position of the reference point in the world, left of x"),
    ("yaw", "rad", "Heading, positive to the left, not wrapped"),
    ("v_x", "m/s", "Forward velocity of the reference point"),
    ("v_y", "m/s", "Velocity of the reference point to the left"),
    ("yaw_rate", "rad/s", "Yaw rate, positive to the left"),
)
"""Name, unit and description of what plants give and the controller takes, in VehicleState's order."""

NO_ACCELERATION, ACCELERATION_START = 1e3, 1e4
"""From which value on a plant's input `acceleration` says that none is given, and what it is until it is set, [m/s^2]:
a number, since importers differ in what they make of NaN, and so far off that no derivative is taken across."""


@dataclass(frozen=True)
class Variable:
    """One row of the table; every variable is a double.

    Attributes:
        name: FMI name (structured naming convention).
        kind: Its role, from which causality, variability and initial follow.
        unit: A key of `UNITS`; empty for dimensionless.
        description: One line.
        start: Value before anything is set; None where it is calculated.
        minimum, maximum: Smallest and largest value that may be set; None for no bound.
        array: Name of the array that it is an element of, whose rows stand one after the other; FMI 3.0 knows that
            array alone, under the value reference of its first element. Empty for a scalar.
    """

    name: str
    kind: Kind
    unit: str
    description: str
    start: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    array: str = ""

    @property
    def constant(self) -> str:
        """Name of the value reference in C."""
        return re.sub(r"\W+", "_", self.name.upper().replace(")", ""))


def elements(array: str, kind: Kind, unit: str, description: str, starts: Sequence[float | None]) -> list[Variable]:
    """The rows of an array: element i of `path.s` is `path[i].s`, from 1 on."""
    owner, _, field = array.rpartition(".")
    return [
        Variable(f"{owner}[{i}].{field}", kind, unit, description, start, array=array)
        for i, start in enumerate(starts, 1)
    ]


@dataclass(frozen=True)
class Model:
    """What is common to the FMI 2.0 and FMI 3.0 form of an FMU.

    Attributes:
        name: As the user calls it.
        description: One line for the XML files.
        variables: The table, in value-reference order; states stand together, and their
            derivatives together in the same order.
        c_files: The C files of its own, beside those that every FMU has.
        identifier: FMI model identifier: name of the binary and of the documentation page.
        takes_nan: Whether an input may be NaN, for "not measured".
        c_lines: Further lines of its C header.
    """

    name: str
    description: str
    variables: tuple[Variable, ...]
    c_files: tuple[str, ...]
    identifier: str
    takes_nan: bool = False
    c_lines: str = ""

    @property
    def spans(self) -> list[int]:
        """Elements of the array that begins at each row: 1 of a scalar, 0 within an array."""
        sizes = Counter(row.array for row in self.variables)
        before = ("", *(row.array for row in self.variables))
        return [
            1 if not row.array else 0 if row.array == previous else sizes[row.array]
            for row, previous in zip(self.variables, before, strict=False)
        ]

    def with_start(self, values: dict[str, float]) -> "Model":
        """The same with other start values, by name, of those variables that it has."""
        rows = (replace(row, start=values.get(row.name, row.start)) for row in self.variables)
        return replace(self, variables=tuple(rows))

    def of_kind(self, *kinds: Kind) -> list[tuple[int, Variable]]:
        """Value reference and row of every variable of these kinds."""
        return [(reference, row) for reference, row in enumerate(self.variables) if row.kind in kinds]


UNITS: dict[str, dict[str, int]] = {
    "s": {"s": 1},
    "1/s": {"s": -1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "kg": {"kg": 1},
    "kg.m2": {"kg": 1, "m": 2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N/rad": {"kg": 1, "m": 1, "s": -2, "rad": -1},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
}
"""Exponents of the SI base units."""


def c_header(model: Model, token: str) -> str:
    """variables.h: value references, and the rows as initialisers of `Variable` in instance.h."""
    references = "".join(f"    {row.constant},\n" for row in model.variables)
    rows = "".join(f"    {_c_row(row, span)}, \\\n" for row, span in zip(model.variables, model.spans, strict=True))
    states = model.of_kind("state", "hidden state")
    return (
        "/* Generated from the variable table: do not edit. */\n#pragma once\n"
        f'#define MODEL_TOKEN "{token}"\n#define GRAVITY {GRAVITY!r}\n#define NO_ACCELERATION {NO_ACCELERATION!r}\n'
        f"enum {{\n{references}    N_VARIABLES,\n"
        f"    FIRST_STATE = {states[0][0] if states else 0},\n    N_STATES = {len(states)}\n}};\n"
        f"#define TAKES_NAN {int(model.takes_nan)}\n#define VARIABLE_ROWS {{ \\\n{rows}}}\n{model.c_lines}"
    )


def _c_row(row: Variable, span: int) -> str:
    kind = row.kind.upper().replace(" ", "_")
    minimum = "-HUGE_VAL" if row.minimum is None else repr(row.minimum)
    maximum = "HUGE_VAL" if row.maximum is None else repr(row.maximum)
    return f'{{"{row.name}", {kind}_KIND, {row.start or 0.0!r}, {minimum}, {maximum}, {span}}}'
