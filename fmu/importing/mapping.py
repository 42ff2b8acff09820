"""Mapping of our signals to the variables of an FMU, read from a TOML file.

reference_point = -1.3                      # where the FMU's position is, ahead of the centre of gravity [m]
estimate = ["yaw_rate", "v_y"]              # what it does not report and is to be worked out from the rest
[inputs]                                    # what the FMU gets; those not named are not set
steer_angle = { variable = "HandWheel", unit = "deg", ratio = 16.0, sign = -1 }
target_speed = { variable = "v_set", unit = "km/h" }
[outputs]                                   # what it reports; those not named have our own names
x = "pos.x"
[start]                                     # parameters that place it, so far as it has such
v_x = { variable = "v0", unit = "km/h" }
[parameters]                                # in the FMU's own units
mass = 1500.0
[vehicle]                                   # the car that it is, as in a scenario file
preset = "bmw-320i"
mass = 1500.0
"""

import math
from collections.abc import Mapping as Lookup
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fmpy.model_description import ScalarVariable

from sidestep.plant_models.documents import file_text, toml_tables
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.checks import GRAVITY
from sidestep.plant_models.vehicle.table import vehicle_from_table

OUTPUTS = ("x", "y", "yaw", "v_x", "v_y", "yaw_rate", "steer_angle")
"""Signals of `VehicleState`, but time, in its order."""

DIMENSIONS = {
    "x": "length", "y": "length", "yaw": "angle", "v_x": "speed", "v_y": "speed", "yaw_rate": "angular rate",
    "steer_angle": "angle", "target_speed": "speed", "acceleration": "acceleration", "throttle": "acceleration",
    "brake": "acceleration",
}  # fmt: skip

UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "mm": 1e-3, "km": 1e3},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0},
    "speed": {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704},
    "angular rate": {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    "acceleration": {"m/s2": 1.0, "g": GRAVITY},
}
"""SI units per unit, by dimension."""

_TABLES = ("inputs", "outputs", "start", "parameters", "vehicle")

INPUTS = ("steer_angle", "target_speed", "acceleration", "throttle", "brake")
"""Signals that an FMU may get as inputs. The last three are the commanded acceleration, its positive part and its
negative part, all in [m/s^2]; where none is commanded it follows from the target speed by the speed control of our own
plants. Braking fades in `acceleration` as the car comes to rest, since an FMU might drive backwards; `brake` stays."""


@dataclass(frozen=True)
class Signal:
    """One variable of an FMU; signal in SI = scale * variable + offset.

    Attributes:
        variable: Name in the FMU.
        scale: SI unit per unit of the variable, negative if its sign is turned.
        offset: Value of the signal where the variable is zero, in SI units.
        limit: Largest magnitude that the variable is given; infinite for none.
    """

    variable: str
    scale: float = 1.0
    offset: float = 0.0
    limit: float = math.inf

    def from_signal(self, value: float) -> float:
        """The variable's value for a signal in SI units."""
        return min(max((value - self.offset) / self.scale, -self.limit), self.limit)


@dataclass(frozen=True)
class Mapping:
    """Where each of our signals is found in an FMU; without arguments, by the names of our own FMUs.

    Attributes:
        inputs: By some of the names in `INPUTS`, the steering among them.
        outputs: By the names in `OUTPUTS`, but those in `estimate`.
        start: Parameters that set the start value, by some of the names in `OUTPUTS`.
        parameters: Values by variable name, in the FMU's own units: numbers, true and false, texts.
        estimate: Outputs that the FMU does not have, see `estimation`.
        reference_point: Where the FMU's position and velocity are taken, ahead of the centre of gravity, in [m].
        vehicle: The car that it is, as the table `vehicle` of a scenario file; empty if it is not told.
    """

    inputs: dict[str, Signal] = field(
        default_factory=lambda: {
            "steer_angle": Signal("steer_angle_command"),
            "target_speed": Signal("target_speed"),
            "acceleration": Signal("acceleration"),
        }
    )
    outputs: dict[str, Signal] = field(default_factory=lambda: {name: Signal(name) for name in OUTPUTS})
    start: dict[str, Signal] = field(default_factory=lambda: {name: Signal(f"{name}_0") for name in OUTPUTS})
    parameters: dict[str, float | str] = field(default_factory=dict)
    estimate: tuple[str, ...] = ()
    reference_point: float = 0.0
    vehicle: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if "steer_angle" not in self.inputs:
            raise InputError("inputs", "no steer_angle: nothing steers the car", "steer_angle = ...")

    def without_unknown(self, variables: Lookup[str, ScalarVariable]) -> "Mapping":
        """Without our acceleration where the inputs are ours and the FMU takes none: the target speed drives it."""
        row = variables.get("acceleration")
        if self.inputs != Mapping().inputs or (row and row.causality == "input"):
            return self
        return replace(self, inputs={name: signal for name, signal in self.inputs.items() if name != "acceleration"})

    @property
    def is_own(self) -> bool:
        """Whether nothing but parameters differs from our own FMUs, or from those that know no acceleration."""
        ours, drive = Mapping(), {"target_speed", "acceleration"}
        both = drive & self.inputs.keys() in ({"target_speed"}, drive)
        return both and replace(self, inputs=ours.inputs | self.inputs, parameters={}) == ours

    @classmethod
    def from_file(cls, path: str | Path) -> "Mapping":
        """Read a TOML file.

        Raises:
            InputError: The file cannot be read, or a key or value in it cannot be used.
        """
        return cls.from_text(file_text(path, "a mapping file"), str(path), Path(path).parent)

    @classmethod
    def from_text(cls, text: str, label: str = "mapping", folder: Path = Path()) -> "Mapping":
        """A mapping from TOML text, which errors call `label`; files that it names are found from `folder`.

        Raises:
            InputError: A key or value in it cannot be used.
        """
        data = toml_tables(text, label)
        _known(label, data, (*_TABLES, "estimate", "reference_point"))
        ours, missing = cls(), _estimated(label, data.get("estimate", []))
        outputs = ours.outputs | _signals(label, data, "outputs", OUTPUTS)
        try:
            return cls(
                inputs=_signals(label, data, "inputs", INPUTS) if "inputs" in data else ours.inputs,
                outputs={name: signal for name, signal in outputs.items() if name not in missing},
                start=_signals(label, data, "start", OUTPUTS),
                parameters={
                    name: value
                    if isinstance(value, str)
                    else _number(f"{label}: parameters.{name}", value, or_bool=True)
                    for name, value in _table(label, data, "parameters").items()
                },
                estimate=missing,
                vehicle=_vehicle(_table(label, data, "vehicle"), folder),
                reference_point=_number(f"{label}: reference_point", data.get("reference_point", 0.0)),
            )
        except InputError as error:
            raise error if error.where.startswith(label) else InputError(
                f"{label}: {error.where}", error.problem, error.allowed
            ) from error  # fmt: skip


def vehicle_table(path: Path) -> dict[str, Any]:
    """The table `vehicle` of a mapping file, empty if it has none.

    Raises:
        InputError: The file cannot be read, or a key or value in it cannot be used.
    """
    return Mapping.from_file(path).vehicle


def _vehicle(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    for key in ("file", "tyre_file"):
        if isinstance(table.get(key), str):
            table = table | {key: str((folder / table[key]).absolute())}
    vehicle_from_table(table)
    return table


def _estimated(label: str, value: Any) -> tuple[str, ...]:
    allowed = OUTPUTS[2:]  # the position is what the rest is worked out from
    if not isinstance(value, list) or any(name not in allowed for name in value):
        raise InputError(f"{label}: estimate", f"{value!r}", f"a list of {', '.join(allowed)}")
    return tuple(name for name in OUTPUTS if name in value)


def _table(label: str, data: dict[str, Any], name: str) -> dict[str, Any]:
    table = data.get(name, {})
    if not isinstance(table, dict):
        raise InputError(f"{label}: {name}", f"{table!r} is not a table", f"[{name}]")
    return table


def _signals(label: str, data: dict[str, Any], name: str, signals: tuple[str, ...]) -> dict[str, Signal]:
    table = _table(label, data, name)
    _known(f"{label}: {name}", table, signals)
    return {signal: _signal(f"{label}: {name}.{signal}", signal, value) for signal, value in table.items()}


def _signal(where: str, name: str, value: Any) -> Signal:
    row = {"variable": value} if isinstance(value, str) else value
    if not isinstance(row, dict) or not isinstance(row.get("variable"), str):
        raise InputError(where, f"{value!r} names no variable", '"name" or { variable = "name", unit, sign, ... }')
    keys = ("variable", "unit", "sign", "scale", "offset", *(("ratio", "full_lock") if name == "steer_angle" else ()))
    _known(where, row, keys)
    numbers = {key: _number(f"{where}.{key}", row[key]) for key in keys[2:] if key in row}
    for key, number in numbers.items():
        if key != "offset" and number == 0.0:
            raise InputError(f"{where}.{key}", "0", "any other number")
    if numbers.get("sign", 1.0) not in (1.0, -1.0):
        raise InputError(f"{where}.sign", f"{row['sign']}", "1, -1")
    scale = numbers.get("sign", 1.0) * numbers.get("scale", 1.0) * _unit(where, name, row.get("unit"))
    scale *= numbers.get("full_lock", 1.0) / numbers.get("ratio", 1.0)
    limit = 1.0 if "full_lock" in numbers else math.inf
    return Signal(row["variable"], scale, numbers.get("offset", 0.0), limit)


def _unit(where: str, name: str, unit: Any) -> float:
    units = UNITS[DIMENSIONS[name]]
    if unit is None:
        return 1.0
    if not isinstance(unit, str) or unit not in units:
        raise InputError(f"{where}.unit", f"{unit!r}", ", ".join(units))
    return units[unit]


def _number(where: str, value: Any, or_bool: bool = False) -> float:
    if (isinstance(value, bool) and not or_bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(where, f"{value!r}", "a finite number")
    return float(value)


def _known(where: str, table: dict[str, Any], allowed: tuple[str, ...]) -> None:
    for key in table:
        if key not in allowed:
            raise InputError(where, f"unknown key {key!r}", ", ".join(allowed))
