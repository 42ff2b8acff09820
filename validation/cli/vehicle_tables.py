"""Cars as tables: the list of those that come with the package, what is known of each, and several side by side."""

import argparse
import math
from dataclasses import fields
from pathlib import Path

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.tyres.formula import cornering_stiffness
from sidestep.plant_models.tyres.property_file import read_tyre_file
from sidestep.plant_models.vehicle.checks import GRAVITY
from sidestep.plant_models.vehicle.library import library, library_cars
from sidestep.plant_models.vehicle.parameters import VehicleParameters, vehicle_presets, vehicle_sources
from sidestep.plant_models.vehicle.suspension import SuspensionParameters

ESTIMATED = "~"
"""Before a number that no public source gives for this very car."""


def understeer(car: VehicleParameters) -> float:
    """Understeer gradient of the bicycle model, in [deg/g], to two digits: load over stiffness, front less rear."""
    front, rear = (car.axle_load(a) / getattr(car, f"cornering_stiffness_{a}") for a in ("front", "rear"))
    return round(math.degrees(front - rear), 2) + 0.0  # neutral is 0, not -0


def characteristic_speed(car: VehicleParameters) -> float:
    """Speed of the largest yaw gain if the car understeers, critical speed if not, in [m/s]; infinite if neutral."""
    gradient = math.radians(abs(understeer(car))) / GRAVITY
    return math.sqrt(car.wheelbase / gradient) if gradient else math.inf


def show_vehicles(options: argparse.Namespace) -> int:
    """What `sidestep vehicles` was asked for; its exit status."""
    from sidestep.validation.cli.arguments import refuse_beside

    if options.tyre:
        refuse_beside("--tyre", {"CAR": options.cars, "--find": options.find})
        _show_tyre(options.tyre)
        return 0
    if options.cars:
        refuse_beside("CAR", {"--find": options.find})
        for name in options.cars:
            VehicleParameters.preset(name)  # refuses names that are none
        _show(options.cars[0]) if len(options.cars) == 1 else _compare(options.cars)
        return 0
    names = [name for name in (*vehicle_presets(), *library_cars()) if (options.find or "").lower() in name]
    if not names:
        raise InputError("--find", f"no car has {options.find!r} in its name", "part of a name, such as honda")
    _list(names)
    return 0


def _list(names: list[str]) -> None:
    columns = ("mass [kg]", "wheelbase", "track [m]", "ratio", "C_f", "C_r [kN/rad]", "understeer [deg/g]")
    print(f"{'car':28}", *(f"{column:>{_width(column)}}" for column in columns), " years", sep="")
    for name in names:
        car, sources = VehicleParameters.preset(name), vehicle_sources(name)
        cells = (
            _cell(f"{car.mass:.0f}", "mass", sources),
            _cell(f"{car.wheelbase:.2f}", "l_f", {}),
            _cell(f"{_mean_track(car):.2f}", "suspension.track_front", sources),
            f"{car.steering_ratio:.1f}" if car.steering_ratio else "-",
            _cell(f"{1e-3 * car.cornering_stiffness_front:.0f}", "cornering_stiffness_front", sources),
            _cell(f"{1e-3 * car.cornering_stiffness_rear:.0f}", "cornering_stiffness_rear", sources),
            _cell(f"{understeer(car):.2f}", "cornering_stiffness_front", sources),
        )
        row = library().get(name)
        padded = (f"{cell:>{_width(column)}}" for cell, column in zip(cells, columns, strict=True))
        print(f"{name:28}", *padded, f" {row.years}" if row else "", sep="")
    print(f"{len(names)} cars; {ESTIMATED} estimated, see `sidestep vehicles CAR`")


def _show(name: str) -> None:
    car, sources = VehicleParameters.preset(name), vehicle_sources(name)
    row = library().get(name)
    print(f"{name}: {row.title}, {row.years}" if row else name)
    print(f"source, where a line has none: {sources['default']}")
    for key, value in _numbers(car).items():
        print(f"  {key:34}{_cell(_text(value), key, sources):>14}  {sources.get(key, '')}".rstrip())
    print(f"  {'understeer gradient [deg/g]':34}{understeer(car):14.2f}  from loads and cornering stiffnesses")
    kind = "critical" if understeer(car) < 0.0 else "characteristic"
    print(f"  {f'{kind} speed [m/s]':34}{characteristic_speed(car):14.1f}  the same")


def _show_tyre(path: Path) -> None:
    read = read_tyre_file(path)
    tyre, load = read.tyre, read.tyre.nominal_load
    stiffness = float(cornering_stiffness(load, tyre.as_array()))
    print(f"{path}: Magic Formula {read.law}")
    for name, value in (
        ("nominal load [N]", load),
        ("cornering stiffness there [N/rad]", stiffness),
        ("peak friction there, lateral", tyre.p_dy1),
        ("peak friction there, longitudinal", tyre.p_dx1),
        ("relaxation length, lateral [m]", tyre.relaxation_y),
        ("relaxation length, longitudinal [m]", tyre.relaxation_x),
    ):
        print(f"  {name:36}{value:12.5g}")
    if read.filled:
        print(f"filled in: {read.filled}")
    print(f"not used: {', '.join(read.unused) or 'nothing'}")


def _compare(names: list[str]) -> None:
    cars, sources = [VehicleParameters.preset(name) for name in names], [vehicle_sources(name) for name in names]
    wide = max(14, *(len(name) + 2 for name in names))
    print(f"{'':34}", *(f"{name:>{wide}}" for name in names), sep="")
    tables = [_numbers(car) for car in cars]
    for key in dict.fromkeys(key for table in tables for key in table):
        cells = (_cell(_text(t.get(key)), key, s) for t, s in zip(tables, sources, strict=True))
        print(f"{key:34}", *(f"{cell:>{wide}}" for cell in cells), sep="")
    print(f"{'understeer gradient [deg/g]':34}", *(f"{understeer(car):>{wide}.2f}" for car in cars), sep="")
    print(f"{'characteristic speed [m/s]':34}", *(f"{characteristic_speed(car):>{wide}.1f}" for car in cars), sep="")


def _numbers(car: VehicleParameters) -> dict[str, float]:
    """The car's own numbers by dotted key; of its tyre only what the preset gives."""
    skipped = ("name", "tyre", "suspension")
    result = {f.name: getattr(car, f.name) for f in fields(car) if f.name not in skipped}
    if car.suspension:
        result |= {f"suspension.{f.name}": getattr(car.suspension, f.name) for f in fields(SuspensionParameters)}
    return result | {"tyre.nominal_load": car.tyre.nominal_load, "tyre.p_dy1": car.tyre.p_dy1}


def _mean_track(car: VehicleParameters) -> float:
    chassis = car.suspension
    return 0.5 * (chassis.track_front + chassis.track_rear) if chassis else math.nan


def _source(key: str, sources: dict[str, str]) -> str:
    return sources.get(key, sources["default"])


def _cell(text: str, key: str, sources: dict[str, str]) -> str:
    is_estimate = bool(sources) and _source(key, sources).startswith("estimated")
    return f"{ESTIMATED}{text}" if is_estimate and text != "-" else text


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.5g}"


def _width(column: str) -> int:
    return max(len(column), 6) + 2
