"""Vehicle data: one frozen record per car, presets as TOML files beside this module."""

import tomllib
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.ranges import Range, check
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.tyres.property_file import read_tyre

GRAVITY = 9.81
"""Acceleration of gravity used by every plant, in [m/s^2]."""

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
    """

    unsprung_mass_front: Annotated[float, Range(0.01, 1e5, "kg")]
    unsprung_mass_rear: Annotated[float, Range(0.01, 1e5, "kg")]
    roll_inertia: Annotated[float, Range(1e-4, 1e8, "kg m²")]
    pitch_inertia: Annotated[float, Range(1e-4, 1e8, "kg m²")]
    spring_front: Annotated[float, Range(1.0, 1e9, "N/m")]
    spring_rear: Annotated[float, Range(1.0, 1e9, "N/m")]
    damper_front: Annotated[float, Range(0.01, 1e8, "N s/m")]
    damper_rear: Annotated[float, Range(0.01, 1e8, "N s/m")]
    anti_roll_front: Annotated[float, Range(0.0, 1e9, "N m/rad")]
    anti_roll_rear: Annotated[float, Range(0.0, 1e9, "N m/rad")]
    track_front: Annotated[float, Range(0.05, 20.0, "m")]
    track_rear: Annotated[float, Range(0.05, 20.0, "m")]
    tyre_stiffness: Annotated[float, Range(1.0, 1e9, "N/m")]
    wheel_radius: Annotated[float, Range(0.01, 5.0, "m")]
    wheel_spin_inertia: Annotated[float, Range(1e-6, 1e4, "kg m²")]
    steer_delay: Annotated[float, Range(0.0, 0.99, "s")] = 0.0

    def __post_init__(self) -> None:
        check(self, "vehicle.suspension")

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
        cornering_stiffness_front, cornering_stiffness_rear: PER AXLE (2 k_f, 2 k_r of the paper), in [N/rad].
        width, length: Outer dimensions, in [m].
        front_overhang: Front axle to front bumper, in [m]; the rear overhang is what is left of the length.
        cg_height: Height of the centre of gravity, in [m].
        steer_limit: Largest road-wheel angle, in [rad].
        steer_rate_limit: Largest road-wheel rate, in [rad/s].
        steer_time_constant: First-order lag of the steering actuator, in [s]; 0 for none.
        max_braking, max_acceleration: Limits of the speed control, in [m/s^2].
        tyre: Magic Formula coefficients, equal on all wheels.
        suspension: Multibody data; None if the car has none.
    """

    name: str
    mass: Annotated[float, Range(0.1, 1e6, "kg")]
    yaw_inertia: Annotated[float, Range(1e-4, 1e8, "kg m²")]
    l_f: Annotated[float, Range(0.05, 50.0, "m")]
    l_r: Annotated[float, Range(0.05, 50.0, "m")]
    cornering_stiffness_front: Annotated[float, Range(1.0, 1e8, "N/rad")]
    cornering_stiffness_rear: Annotated[float, Range(1.0, 1e8, "N/rad")]
    width: Annotated[float, Range(0.05, 20.0, "m")]
    length: Annotated[float, Range(0.1, 100.0, "m")]
    front_overhang: Annotated[float, Range(0.001, 50.0, "m")]
    cg_height: Annotated[float, Range(0.001, 10.0, "m")]
    steer_limit: Annotated[float, Range(0.001, 1.57, "rad")]
    steer_rate_limit: Annotated[float, Range(0.001, 100.0, "rad/s")]
    steer_time_constant: Annotated[float, Range(0.0, 0.99, "s")] = 0.05
    max_braking: Annotated[float, Range(0.01, 100.0, "m/s²")] = 8.0
    max_acceleration: Annotated[float, Range(0.01, 100.0, "m/s²")] = 3.0
    tyre: TyreParameters = field(default_factory=TyreParameters)
    suspension: SuspensionParameters | None = None

    def __post_init__(self) -> None:
        check(self, "vehicle")
        if self.rear_overhang < 0.0:
            raise InputError(
                "vehicle.length", f"{self.length} m is shorter than wheelbase and front overhang",
                f">= {self.wheelbase + self.front_overhang:.3f}",
            )  # fmt: skip

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

        `tyre_file` names a .tir file, seen from this file's folder; `tyre` then changes what it says.

        Raises:
            InputError: The file cannot be read, or a key or value in it cannot be used.
        """
        try:
            data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise InputError(str(path), str(error)) from error
        data.setdefault("name", Path(path).stem)
        try:
            data["tyre"] = _tyre(data, Path(path).parent)
            if "suspension" in data:
                data["suspension"] = _build(SuspensionParameters, "vehicle.suspension", data["suspension"])
            vehicle = _build(cls, "vehicle", data)
        except InputError as error:
            raise InputError(f"{path}: {error.where}", error.problem, error.allowed) from error
        return vehicle.with_(**overrides) if overrides else vehicle

    def with_(self, **overrides: Any) -> "VehicleParameters":
        """A copy with some fields replaced.

        Raises:
            InputError: No such field, or a value out of range.
        """
        for key in overrides:
            _require_known(type(self), "vehicle", key)
        return replace(self, **overrides)


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
