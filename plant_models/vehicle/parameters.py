"""Vehicle data: one frozen record per car, presets as TOML files beside this module."""

import math
import tomllib
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.tyres.formula import cornering_stiffness
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.tyres.property_file import read_tyre

GRAVITY = 9.81
"""Acceleration of gravity used by every plant, in [m/s^2]."""

AXLES = ("front", "rear")

_OR_ZERO = ("anti_roll_front", "anti_roll_rear", "steer_delay", "roll_centre_front", "roll_centre_rear")
_PRESETS = Path(__file__).parent / "presets"


@dataclass(frozen=True)
class SuspensionParameters:
    """Chassis data that only multibody plants need (CommonRoad vehicle models, appendix tables).

    Attributes:
        unsprung_mass_front, unsprung_mass_rear: Unsprung mass PER AXLE, in [kg]; the rest of the car is sprung.
        roll_inertia, pitch_inertia: Inertia of the sprung mass, in [kg m^2].
        spring_front, spring_rear: Wheel rate per wheel, in [N/m].
        damper_front, damper_rear: Damping per wheel, in [N s/m].
        anti_roll_front, anti_roll_rear: Auxiliary roll stiffness per axle, in [N m/rad].
        track_front, track_rear: Track width, in [m].
        tyre_stiffness: Vertical tyre stiffness per wheel, in [N/m].
        wheel_radius: Unloaded radius, in [m].
        wheel_spin_inertia: Spin inertia per wheel, in [kg m^2].
        steer_delay: Time until the steering actuator hears a command, in [s].
        roll_centre_front, roll_centre_rear: Height of the roll centre of the axle above the road, in [m]: where the
            suspension passes the tyres' lateral forces to the body. 0 leaves all of them to springs and dampers.
    """

    unsprung_mass_front: float
    unsprung_mass_rear: float
    roll_inertia: float
    pitch_inertia: float
    spring_front: float
    spring_rear: float
    damper_front: float
    damper_rear: float
    anti_roll_front: float
    anti_roll_rear: float
    track_front: float
    track_rear: float
    tyre_stiffness: float
    wheel_radius: float
    wheel_spin_inertia: float
    steer_delay: float = 0.0
    roll_centre_front: float = 0.0
    roll_centre_rear: float = 0.0

    def __post_init__(self) -> None:
        _require_positive(self, or_zero=_OR_ZERO)
        if self.steer_delay >= 1.0:
            raise InputError("vehicle.suspension.steer_delay", f"{self.steer_delay} s", "0 <= value < 1")

    def roll_of_axle(self, axle: str) -> tuple[float, float]:
        """Roll stiffness [N m/rad] of springs and anti-roll bar, and roll damping [N m s/rad], of "front" or "rear"."""
        lever = 0.5 * getattr(self, f"track_{axle}") ** 2  # half the track squared times two wheels
        stiffness = getattr(self, f"spring_{axle}") * lever + getattr(self, f"anti_roll_{axle}")
        return stiffness, getattr(self, f"damper_{axle}") * lever


@dataclass(frozen=True)
class VehicleParameters:
    """A car, as the bicycle model, the planner and the plants see it.

    Attributes:
        name: Name of the preset or file.
        mass: Total mass m, in [kg].
        yaw_inertia: TOTAL yaw inertia I_z, in [kg m^2].
        l_f, l_r: Distance of front and rear axle from the centre of gravity, in [m].
        cornering_stiffness_front, cornering_stiffness_rear: PER AXLE (2 k_f, 2 k_r of the paper), in [N/rad], at the
            static load: of the linear tyres, and of `tyre` as the axle mounts it (`tyre_scale`).
        width, length: Outer dimensions, in [m].
        front_overhang: Front axle to front bumper, in [m]; the rear overhang is what is left of the length.
        cg_height: Height of the centre of gravity, in [m].
        steer_limit: Largest road-wheel angle, in [rad].
        steer_rate_limit: Largest road-wheel rate, in [rad/s].
        steer_time_constant: First-order lag of the steering actuator, in [s]; 0 for none.
        max_braking, max_acceleration: Limits of the speed control, in [m/s^2].
        tyre: Magic Formula coefficients, equal on all wheels but for the stiffness of their axle.
        suspension: Multibody data; None if the car has none.
    """

    name: str
    mass: float
    yaw_inertia: float
    l_f: float
    l_r: float
    cornering_stiffness_front: float
    cornering_stiffness_rear: float
    width: float
    length: float
    front_overhang: float
    cg_height: float
    steer_limit: float
    steer_rate_limit: float
    steer_time_constant: float = 0.05
    max_braking: float = 8.0
    max_acceleration: float = 3.0
    tyre: TyreParameters = field(default_factory=TyreParameters)
    suspension: SuspensionParameters | None = None

    def __post_init__(self) -> None:
        _require_positive(self, or_zero=("steer_time_constant",))
        if self.steer_time_constant >= 1.0:
            raise InputError("vehicle.steer_time_constant", f"{self.steer_time_constant} s", "0 <= value < 1")
        if self.steer_limit >= math.pi / 2:
            raise InputError("vehicle.steer_limit", f"{self.steer_limit} rad", "0 < value < pi/2")
        if self.rear_overhang < 0.0:
            raise InputError(
                "vehicle.length", f"{self.length} m is shorter than wheelbase and front overhang",
                f">= {self.wheelbase + self.front_overhang:.3f}",
            )  # fmt: skip

        for axle in AXLES:
            if getattr(self.suspension, f"roll_centre_{axle}", 0.0) >= self.cg_height:
                raise InputError(
                    f"vehicle.suspension.roll_centre_{axle}", "not below the centre of gravity", f"< {self.cg_height}"
                )  # fmt: skip

    def axle_load(self, axle: str) -> float:
        """Static load of the axle "front" or "rear", in [N]."""
        return self.mass * GRAVITY * (self.l_r if axle == "front" else self.l_f) / self.wheelbase

    def tyre_stiffness(self, axle: str) -> float:
        """Cornering stiffness of two tyres as `tyre` says, at the axle's static load, in [N/rad]."""
        return 2.0 * float(cornering_stiffness(0.5 * self.axle_load(axle), self.tyre.as_array()))

    def tyre_scale(self, axle: str) -> float:
        """What the cornering stiffness of `tyre` is multiplied by on this axle: the axle's over the tyres'."""
        return getattr(self, f"cornering_stiffness_{axle}") / self.tyre_stiffness(axle)

    @property
    def wheelbase(self) -> float:
        """l_f + l_r, in [m]."""
        return self.l_f + self.l_r

    @property
    def rear_overhang(self) -> float:
        """Rear axle to rear bumper, in [m]."""
        return self.length - self.wheelbase - self.front_overhang

    @property
    def front_extent(self) -> float:
        """Centre of gravity to front bumper, in [m]."""
        return self.l_f + self.front_overhang

    @property
    def rear_extent(self) -> float:
        """Centre of gravity to rear bumper, in [m]."""
        return self.l_r + self.rear_overhang

    @classmethod
    def preset(cls, name: str, **overrides: Any) -> "VehicleParameters":
        """A built-in car, with single values replaced.

        Args:
            name: One of `vehicle_presets()`.
            overrides: Fields of this class by name.

        Raises:
            InputError: No such preset or field, or a value out of range.
        """
        if name not in vehicle_presets():
            raise InputError("vehicle.preset", f"unknown preset {name!r}", ", ".join(vehicle_presets()))
        return cls.from_file(_PRESETS / f"{name}.toml", **overrides)

    @classmethod
    def from_file(cls, path: str | Path, **overrides: Any) -> "VehicleParameters":
        """Read a vehicle TOML file: the fields of this class, tables `tyre` and `suspension`.

        `tyre_file` names a .tir file, seen from this file's folder; `tyre` then changes what it says. Cornering
        stiffnesses that the file does not give are the tyres'; one source alone may say them.

        Raises:
            InputError: The file cannot be read, or a key or value in it cannot be used.
        """
        try:
            data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise InputError(str(path), str(error)) from error
        data.setdefault("name", Path(path).stem)
        try:
            require_one_stiffness(data)
            data["tyre"] = _tyre(data, Path(path).parent)
            if "suspension" in data:
                data["suspension"] = _build(SuspensionParameters, "vehicle.suspension", data["suspension"])
            unsaid = [f"cornering_stiffness_{axle}" for axle in AXLES if f"cornering_stiffness_{axle}" not in data]
            if len(unsaid) == 1:
                raise InputError(f"vehicle.{unsaid[0]}", "missing", "the stiffness of both axles, or of neither")
            vehicle = _build(cls, "vehicle", {**dict.fromkeys(unsaid, 1.0), **data})
            if unsaid:
                vehicle = vehicle.on_tyres(vehicle.tyre)
        except InputError as error:
            raise InputError(f"{path}: {error.where}", error.problem, error.allowed) from error
        return vehicle.with_(**overrides) if overrides else vehicle

    def with_(self, **overrides: Any) -> "VehicleParameters":
        """A copy with some fields replaced.

        The tyres stay on the car: where load or tyre change, so does the stiffness of an axle that is not given.

        Raises:
            InputError: No such field, or a value out of range.
        """
        for key in overrides:
            _require_known(type(self), "vehicle", key)
        changed = replace(self, **overrides)
        if not overrides.keys() & {"mass", "l_f", "l_r", "tyre"}:
            return changed
        kept = {
            f"cornering_stiffness_{axle}": self.tyre_scale(axle) * changed.tyre_stiffness(axle)
            for axle in AXLES
            if f"cornering_stiffness_{axle}" not in overrides
        }
        return replace(changed, **kept)

    def on_tyres(self, tyre: TyreParameters) -> "VehicleParameters":
        """The car on four tyres of one make, whose stiffness both axles then have."""
        bare = replace(self, tyre=tyre)
        return replace(bare, **{f"cornering_stiffness_{axle}": bare.tyre_stiffness(axle) for axle in AXLES})


def require_one_stiffness(table: dict[str, Any]) -> None:
    """Refuse a table of a vehicle that says how stiff the tyres are in two places.

    Raises:
        InputError: With the second place.
    """
    given = [axle for axle in AXLES if f"cornering_stiffness_{axle}" in table]
    tyre = table.get("tyre")
    second = "tyre_file" if table.get("tyre_file") else "tyre.p_ky1" if isinstance(tyre, dict) and "p_ky1" in tyre else ""
    if given and second:
        raise InputError(
            f"vehicle.{second}", f"says how stiff the tyres are, and so does cornering_stiffness_{given[0]}", "one of them"
        )  # fmt: skip


def vehicle_presets() -> tuple[str, ...]:
    """Names of the built-in cars."""
    return tuple(sorted(file.stem for file in _PRESETS.glob("*.toml")))


def _tyre(data: dict[str, Any], folder: Path) -> TyreParameters:
    file, table = data.pop("tyre_file", ""), data.get("tyre", {})
    tyre = _build(TyreParameters, "vehicle.tyre", table)
    return replace(read_tyre(folder / str(file)), **table) if file else tyre


def _build(cls: type, where: str, data: Any) -> Any:
    if not isinstance(data, dict):
        raise InputError(where, f"{data!r} is not a table", ", ".join(f.name for f in fields(cls)))
    for key in data:
        _require_known(cls, where, key)
    missing = [f.name for f in fields(cls) if f.name not in data and _is_required(f)]
    if missing:
        raise InputError(where, f"missing {', '.join(missing)}")
    return cls(**data)


def _is_required(f: Any) -> bool:
    return f.default is MISSING and f.default_factory is MISSING


def _require_known(cls: type, where: str, key: str) -> None:
    names = [f.name for f in fields(cls)]
    if key not in names:
        raise InputError(f"{where}.{key}", "unknown key", ", ".join(names))


def _require_positive(record: Any, or_zero: tuple[str, ...]) -> None:
    table = "vehicle" if isinstance(record, VehicleParameters) else "vehicle.suspension"
    for f in fields(record):
        if f.name in ("name", "tyre", "suspension"):
            continue
        value, allowed = getattr(record, f.name), ">= 0" if f.name in or_zero else "> 0"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{table}.{f.name}", f"{value!r} is not a number", f"a number {allowed}")
        if not math.isfinite(value) or value < 0.0 or (value == 0.0 and f.name not in or_zero):
            raise InputError(f"{table}.{f.name}", f"{value}", allowed)
