"""Vehicle data: one frozen record per car, presets as TOML files beside this module."""

import difflib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from sidestep.plant_models.documents import read_toml
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.ranges import Range, check
from sidestep.plant_models.tyres.formula import cornering_stiffness
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.tyres.property_file import read_tyre
from sidestep.plant_models.vehicle.checks import GRAVITY, built, require_known
from sidestep.plant_models.vehicle.library import library_car, library_cars
from sidestep.plant_models.vehicle.suspension import SuspensionParameters

AXLES = ("front", "rear")
STIFFNESSES = tuple(f"cornering_stiffness_{axle}" for axle in AXLES)

_PRESETS = Path(__file__).parent / "presets"


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
        steering_ratio: Angle of the steering wheel over that of the road wheels; None if not known.
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
    cg_height: Annotated[float, Range(1e-9, 10.0, "m")]
    steer_limit: Annotated[float, Range(0.001, 1.57, "rad")]
    steer_rate_limit: Annotated[float, Range(0.001, 100.0, "rad/s")]
    steer_time_constant: Annotated[float, Range(0.0, 0.99, "s")] = 0.05
    max_braking: Annotated[float, Range(1e-6, 100.0, "m/s²")] = 8.0
    max_acceleration: Annotated[float, Range(1e-6, 100.0, "m/s²")] = 3.0
    tyre: TyreParameters = field(default_factory=TyreParameters)
    suspension: SuspensionParameters | None = None
    steering_ratio: Annotated[float, Range(1.0, 100.0)] | None = None

    def __post_init__(self) -> None:
        check(self, "vehicle")
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
        if name in library_cars():
            return _vehicle(cls, library_car(name), f"preset {name}", _PRESETS).with_(**overrides)
        if name not in vehicle_presets():
            known = (*vehicle_presets(), *library_cars())
            close = difflib.get_close_matches(name, known, n=1)
            problem = f"unknown preset {name!r}" + (f", did you mean {close[0]}?" if close else "")
            raise InputError("vehicle.preset", problem, f"{', '.join(vehicle_presets())}, one of `sidestep vehicles`")
        return cls.from_file(_PRESETS / f"{name}.toml", **overrides)

    @classmethod
    def from_file(cls, path: str | Path, **overrides: Any) -> "VehicleParameters":
        """Read a vehicle TOML file: the fields of this class, tables `tyre` and `suspension`.

        `tyre_file` names a .tir file, seen from this file's folder; `tyre` then changes what it says. Cornering
        stiffnesses that the file does not give are the tyres'; one source alone may say them. The table `source`
        tells, in words, where a number is from.

        Raises:
            InputError: The file cannot be read, or a key or value in it cannot be used.
        """
        return _vehicle(cls, read_tables(path), str(path), Path(path).parent).with_(**overrides)

    def with_(self, **overrides: Any) -> "VehicleParameters":
        """A copy with some fields replaced.

        The tyres stay on the car: where load or tyre change, so does the stiffness of an axle that is not given.

        Raises:
            InputError: No such field, or a value out of range.
        """
        for key in overrides:
            require_known(type(self), "vehicle", key)
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
    given = [name for name in STIFFNESSES if name in table]
    tyre = table.get("tyre")
    second = (
        "tyre_file" if table.get("tyre_file") else "tyre.p_ky1" if isinstance(tyre, dict) and "p_ky1" in tyre else ""
    )
    if given and second:
        raise InputError(
            f"vehicle.{second}", f"says how stiff the tyres are, and so does {given[0]}", "one of them"
        )  # fmt: skip


def vehicle_presets() -> tuple[str, ...]:
    """Names of the cars that come as files of their own; `library.library_cars` has those of the table."""
    return tuple(sorted(file.stem for file in _PRESETS.glob("*.toml")))


def vehicle_sources(name: str) -> dict[str, str]:
    """Where the numbers of a preset are from, by field; "default" stands for all others.

    What begins with "estimated" is no published number of this car.
    """
    tables = library_car(name) if name in library_cars() else read_tables(_PRESETS / f"{name}.toml")
    return tables["source"]


def read_tables(path: str | Path) -> dict[str, Any]:
    """The tables of a vehicle file.

    Raises:
        InputError: It cannot be read.
    """
    return {"name": Path(path).stem, **read_toml(path)}


def _vehicle(cls: type[VehicleParameters], tables: dict[str, Any], label: str, folder: Path) -> VehicleParameters:
    """The vehicle of a file's tables; files that they name are seen from `folder`."""
    data = dict(tables)
    try:
        _check_sources(data.pop("source", {}))
        require_one_stiffness(data)
        data["tyre"] = _tyre(data, folder)
        if "suspension" in data:
            data["suspension"] = built(SuspensionParameters, "vehicle.suspension", data["suspension"])
        unsaid = [name for name in STIFFNESSES if name not in data]
        if len(unsaid) == 1:
            raise InputError(f"vehicle.{unsaid[0]}", "missing", "the stiffness of both axles, or of neither")
        vehicle = built(cls, "vehicle", {**dict.fromkeys(unsaid, 1.0), **data})
    except InputError as error:
        raise InputError(f"{label}: {error.where}", error.problem, error.allowed) from error
    return vehicle.on_tyres(vehicle.tyre) if unsaid else vehicle


def _check_sources(table: Any) -> None:
    if not isinstance(table, dict):
        raise InputError("vehicle.source", f"{table!r} is not a table")
    for key, value in table.items():
        place, _, name = key.rpartition(".")
        if key != "default":
            cls = {"tyre": TyreParameters, "suspension": SuspensionParameters}.get(place, VehicleParameters)
            require_known(cls, "vehicle.source", name)
        if not isinstance(value, str):
            raise InputError(f"vehicle.source.{key}", f"{value!r} is not text")


def _tyre(data: dict[str, Any], folder: Path) -> TyreParameters:
    file, table = data.pop("tyre_file", ""), data.get("tyre", {})
    tyre = built(TyreParameters, "vehicle.tyre", table)
    return replace(read_tyre(folder / str(file)), **table) if file else tyre
