"""Mapping of our signals to the variables of an FMU, read from a TOML file.

[inputs]                                    # what the FMU is told
steer_angle = { variable = "delta_cmd", scale = 0.017453292519943295 }     # degrees
target_speed = "v_set"
[outputs]                                   # what it reports; signals not named keep our own names
yaw_rate = "psi_dot"
[start]                                     # parameters that place it, so far as it has such
v_x = "v0"
[parameters]
mass = 1500.0
"""

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError

INPUTS = ("steer_angle", "target_speed")
"""Signals of `SteeringCommand` that go to the FMU."""

OUTPUTS = ("x", "y", "yaw", "v_x", "v_y", "yaw_rate", "steer_angle")
"""Signals of `VehicleState`, but time, in its order."""


@dataclass(frozen=True)
class Signal:
    """One variable of an FMU; signal in SI = scale * variable + offset.

    Attributes:
        variable: Name in the FMU.
        scale: SI unit per unit of the variable, negative if its sign is turned.
        offset: Value of the signal where the variable is zero, in SI units.
    """

    variable: str
    scale: float = 1.0
    offset: float = 0.0

    def from_signal(self, value: float) -> float:
        """The variable's value for a signal in SI units."""
        return (value - self.offset) / self.scale


@dataclass(frozen=True)
class Mapping:
    """Where each of our signals is found in an FMU; without arguments, by the names of our own FMUs.

    Attributes:
        inputs: By the names in `INPUTS`.
        outputs: By the names in `OUTPUTS`.
        start: Parameters that set the start value, by some of the names in `OUTPUTS`.
        parameters: Values by variable name, in the FMU's own units.
    """

    inputs: dict[str, Signal] = field(
        default_factory=lambda: {"steer_angle": Signal("steer_angle_command"), "target_speed": Signal("target_speed")}
    )
    outputs: dict[str, Signal] = field(default_factory=lambda: {name: Signal(name) for name in OUTPUTS})
    start: dict[str, Signal] = field(default_factory=lambda: {name: Signal(f"{name}_0") for name in OUTPUTS})
    parameters: dict[str, float] = field(default_factory=dict)

    @classmethod
    def from_file(cls, path: str | Path) -> "Mapping":
        """Read a TOML file; inputs and outputs that it does not name keep our own names.

        Raises:
            InputError: The file cannot be read, or a key or value in it cannot be used.
        """
        try:
            data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            problem = error.strerror if isinstance(error, OSError) else str(error)
            raise InputError(str(path), f"{problem}") from error
        _known(str(path), data, ("inputs", "outputs", "start", "parameters"))
        ours = cls()
        return cls(
            inputs=ours.inputs | _signals(path, data, "inputs", INPUTS),
            outputs=ours.outputs | _signals(path, data, "outputs", OUTPUTS),
            start=_signals(path, data, "start", OUTPUTS),
            parameters={
                name: _number(f"{path}: parameters.{name}", value)
                for name, value in _table(path, data, "parameters").items()
            },
        )


def _table(path: str | Path, data: dict[str, Any], name: str) -> dict[str, Any]:
    table = data.get(name, {})
    if not isinstance(table, dict):
        raise InputError(f"{path}: {name}", f"{table!r} is not a table", f"[{name}]")
    return table


def _signals(path: str | Path, data: dict[str, Any], name: str, signals: tuple[str, ...]) -> dict[str, Signal]:
    table = _table(path, data, name)
    _known(f"{path}: {name}", table, signals)
    return {signal: _signal(f"{path}: {name}.{signal}", value) for signal, value in table.items()}


def _signal(where: str, value: Any) -> Signal:
    row = {"variable": value} if isinstance(value, str) else value
    if not isinstance(row, dict) or not isinstance(row.get("variable"), str):
        raise InputError(where, f"{value!r} names no variable", '"name" or { variable = "name", scale, offset }')
    _known(where, row, ("variable", "scale", "offset"))
    scale = _number(f"{where}.scale", row.get("scale", 1.0))
    if scale == 0.0:
        raise InputError(f"{where}.scale", "0", "any other number")
    return Signal(row["variable"], scale, _number(f"{where}.offset", row.get("offset", 0.0)))


def _number(where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(where, f"{value!r}", "a finite number")
    return float(value)


def _known(where: str, table: dict[str, Any], allowed: tuple[str, ...]) -> None:
    for key in table:
        if key not in allowed:
            raise InputError(where, f"unknown key {key!r}", ", ".join(allowed))
