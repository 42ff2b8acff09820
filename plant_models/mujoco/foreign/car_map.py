"""What a small TOML file tells of somebody else's MJCF car; what it leaves out is found in the model.

chassis = "base_link"                 # a body of the car
forward = "y"                         # the chassis body's own axis that points ahead: x, -x, y, -y, z, -z
wheels = ["tyre_1", "tyre_2"]         # geoms, bodies or joints of all wheels
steering = ["servo"]                  # actuators that steer, or joints, which get servos
drive = ["motor_rl", "motor_rr"]      # actuators that drive, or wheel joints, which get motors
road = "floor"                        # the geom whose friction and softness the road takes
[hold]                                # what other actuators are told all the time
gearbox = 1.0
[vehicle]                             # what the controller believes, as in a scenario file
steer_rate_limit = 0.8
"""

import math
import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError, did_you_mean
from sidestep.plant_models.vehicle.table import vehicle_from_table

AXES = ("x", "-x", "y", "-y", "z", "-z")
_TEXTS, _LISTS = ("chassis", "forward", "road"), ("wheels", "steering", "drive")


@dataclass(frozen=True)
class CarMap:
    """Names of the model's parts; empty where they are to be found.

    Attributes:
        chassis: Body that belongs to the car.
        forward: One of AXES, of that body or of the one with the free joint; empty for where the steered wheels are.
        wheels: Geoms, bodies or joints of all wheels.
        steering: Actuators that steer; joints get servos.
        drive: Actuators that drive; joints of wheels get motors.
        road: Geom whose contact properties the road takes.
        hold: Constant controls of other actuators.
        vehicle: Table `vehicle` of a scenario file.
    """

    chassis: str = ""
    forward: str = ""
    wheels: tuple[str, ...] = ()
    steering: tuple[str, ...] = ()
    drive: tuple[str, ...] = ()
    road: str = ""
    hold: dict[str, float] = field(default_factory=dict)
    vehicle: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def from_file(cls, path: str | Path) -> "CarMap":
        """Read a TOML file.

        Raises:
            InputError: The file cannot be read, or a key or value in it cannot be used.
        """
        try:
            data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise InputError(str(path), getattr(error, "strerror", None) or str(error)) from error
        return cls(**{key: _value(str(path), key, value, Path(path).parent) for key, value in data.items()})


def _value(label: str, key: str, value: Any, folder: Path) -> Any:
    known = [f.name for f in fields(CarMap)]
    if key not in known:
        raise InputError(f"{label}: {key}", f"unknown key{did_you_mean(key, known)}", ", ".join(known))
    where = f"{label}: {key}"
    if key in _TEXTS:
        allowed = AXES if key == "forward" else ()
        if not isinstance(value, str) or (allowed and value not in allowed):
            raise InputError(where, f"{value!r}", ", ".join(allowed) or "a name in the model")
        return value
    if key in _LISTS:
        names = [value] if isinstance(value, str) else value
        if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
            raise InputError(where, f"{value!r}", "a list of names in the model")
        return tuple(names)
    if not isinstance(value, dict):
        raise InputError(where, f"{value!r} is not a table", f"[{key}]")
    return _hold(where, value) if key == "hold" else _vehicle(label, value, folder)


def _hold(where: str, table: dict[str, Any]) -> dict[str, float]:
    for name, value in table.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{where}.{name}", f"{value!r}", "a finite number")
    return {name: float(value) for name, value in table.items()}


def _vehicle(label: str, table: dict[str, Any], folder: Path) -> dict[str, Any]:
    for key in ("file", "tyre_file"):
        if isinstance(table.get(key), str):
            table = table | {key: str((folder / table[key]).absolute())}
    try:
        vehicle_from_table({key: value for key, value in table.items() if key in ("preset", "file", "tyre_file")})
    except InputError as error:
        raise InputError(f"{label}: {error.where}", error.problem, error.allowed) from error
    return table
