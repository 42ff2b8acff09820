"""The mapping file of a log: which column or CAN signal is what, in what unit, and what is known of the car.

time = "time [s]"                    # tables; found by its name if left out
dbc = "car.dbc"                      # CAN logs
rear_drive = 1.0                     # share of the drive at the rear axle

[signals]                            # a name, or a table
steer = "road_wheel_angle [rad]"
yaw_rate = { name = "YAW_RATE", unit = "deg/s", sign = -1 }
v_x = { name = ["wheel_rl", "wheel_rr"], unit = "km/h" }

[vehicle]                            # as in a scenario file
mass = 982.0
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from sidestep.plant_models.documents import read_toml
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.scenarios.tables import checked, did_you_mean, file_at

SIGNALS = {
    "steer": "angle", "steering_wheel": "angle", "v_x": "speed", "yaw_rate": "rate", "a_y": "acceleration",
    "a_x": "acceleration", "v_y": "speed", "sideslip": "angle",
}  # fmt: skip
"""Signals that can be mapped, and what kind of quantity each is."""
NEEDED_OF_CAR = ("mass", "l_f", "l_r")
"""Fields of `[vehicle]` that no log tells."""


@dataclass(frozen=True)
class SignalMap:
    """Where a signal comes from.

    Attributes:
        name: Column or CAN signal (`MESSAGE.SIGNAL` where a name is not unique); several are averaged.
        unit: If the file does not say; wins over the file's.
        sign: +1 for ISO 8855 (left positive); 0 to find it.
        factor: Further factor on the measured value.
        ratio: Steering wheel over road wheel, for `steering_wheel`; 0 to find it.
        delay: By how much the signal is late, in [s], if known; found where the data tell if None.
        position: Of the v_y sensor ahead of the centre of gravity, in [m].
    """

    name: str | list[str]
    unit: str | None = None
    sign: Literal[-1, 0, 1] = 0
    factor: float = 1.0
    ratio: float = 0.0
    delay: float | None = None
    position: float = 0.0

    @property
    def names(self) -> list[str]:
        """The columns."""
        return [self.name] if isinstance(self.name, str) else self.name


@dataclass(frozen=True)
class LogMap:
    """A mapping file.

    Attributes:
        signals: By name of SIGNALS.
        vehicle: What is told of the car, the rest from the preset.
        told: Keys that `[vehicle]` has.
        time, time_unit: Column of the time, and its unit; found if empty.
        dbc: Database of a CAN log, if any.
        rear_drive: Share of the drive at the rear axle.
        least_speed: Below it nothing is used, in [m/s].
    """

    signals: Mapping[str, SignalMap]
    vehicle: VehicleParameters
    told: tuple[str, ...]
    time: str = ""
    time_unit: str = ""
    dbc: Path | None = None
    rear_drive: float = 1.0
    least_speed: float = 5.0


@dataclass(frozen=True)
class _File:
    signals: dict[str, Any] = field(default_factory=dict)
    vehicle: dict[str, Any] = field(default_factory=dict)
    time: str = ""
    time_unit: str = ""
    dbc: str = ""
    rear_drive: float = 1.0
    least_speed: float = 5.0


def read_map(path: Path) -> LogMap:
    """Read a mapping file.

    Raises:
        InputError: It cannot be read, or a key or value in it cannot be used.
    """
    table = read_toml(path)
    try:
        values = checked(_File, table)
        return _built(values, path.parent)
    except InputError as error:
        raise InputError(f"{path}: {error.where}", error.problem, error.allowed) from error


def _built(values: dict[str, Any], folder: Path) -> LogMap:
    signals = {}
    for name, entry in values.pop("signals", {}).items():
        if name not in SIGNALS:
            raise InputError(f"signals.{name}", f"unknown signal{did_you_mean(name, SIGNALS)}", ", ".join(SIGNALS))
        entry = entry if isinstance(entry, dict) else {"name": entry}
        signals[name] = SignalMap(**checked(SignalMap, entry, f"signals.{name}"))
    if values.get("least_speed", 5.0) < 3.0:
        raise InputError("least_speed", f"{values['least_speed']}", ">= 3")
    if not 0.0 <= values.get("rear_drive", 1.0) <= 1.0:
        raise InputError("rear_drive", f"{values['rear_drive']}", "0 <= value <= 1")
    dbc = values.pop("dbc", "")
    vehicle, told = _vehicle(values.pop("vehicle", {}), folder)
    return LogMap(signals, vehicle, told, dbc=file_at(folder, dbc, "dbc") if dbc else None, **values)


def _vehicle(table: dict[str, Any], folder: Path) -> tuple[VehicleParameters, tuple[str, ...]]:
    table = dict(table)
    preset, file = table.pop("preset", ""), table.pop("file", "")
    checked(VehicleParameters, table, "vehicle", partial=True)
    missing = [name for name in NEEDED_OF_CAR if name not in table]
    if not preset and not file and missing:
        raise InputError("vehicle", f"missing {', '.join(missing)}", "mass, l_f and l_r, or preset or file")
    told = tuple({*table, *NEEDED_OF_CAR})
    name = table.pop("name", "identified")
    if "length" not in table and not file and not preset:  # room for the wheelbase; the outline is not measured here
        table |= {"length": table["l_f"] + table["l_r"] + 1.9, "front_overhang": 0.95}
    if file:
        return VehicleParameters.from_file(file_at(folder, file, "vehicle.file"), name=name, **table), told
    if not preset:
        table["suspension"] = None  # another car's
    return VehicleParameters.preset(preset or "bmw-320i").with_(name=name, **table), told
