"""A car told by a table of a file: a preset or a vehicle file, with single values replaced."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.tyres.property_file import read_tyre
from sidestep.plant_models.vehicle.parameters import VehicleParameters

DEFAULT = "bmw-320i"
"""The preset where nothing tells the car."""
WHOLE = ("preset", "file")
"""Keys that tell a whole car."""


def vehicle_from_table(
    table: dict[str, Any], folder: Path = Path(), known: VehicleParameters | None = None
) -> VehicleParameters:
    """The car of a table `vehicle`.

    Args:
        table: preset, file and tyre_file, and fields of `VehicleParameters`.
        folder: From which the files in it are found.
        known: The car where neither preset nor file is told; None for DEFAULT.

    Raises:
        InputError: Unknown key, a value out of range, or a file that cannot be read.
    """
    values = dict(table)
    preset, file, tyre_file = values.pop("preset", ""), values.pop("file", ""), values.pop("tyre_file", "")
    if file:
        base = VehicleParameters.from_file(folder / file)
    else:
        base = known if known and not preset else VehicleParameters.preset(preset or DEFAULT)
    if tyre_file:
        base = base.on_tyres(read_tyre(folder / tyre_file))
    for name in ("tyre", "suspension"):
        if name in values:
            values[name] = _changed(getattr(base, name), values[name], name)
    return base.with_(**values)


def _changed(record: Any, table: Any, name: str) -> Any:
    known = [f.name for f in fields(record)] if record else []
    for key in table if isinstance(table, dict) else [table]:
        if key not in known:
            raise InputError(f"vehicle.{name}", f"unknown key {key!r}", ", ".join(known) or "no such table")
    return replace(record, **table)


def assumed(table: dict[str, Any], vehicle: VehicleParameters) -> str:
    """What is taken for granted of a car, as a sentence: how it was told, and what it weighs."""
    told = ", ".join(f"{key} {table[key]}" for key in WHOLE if key in table)
    own = ", ".join(sorted(table.keys() - set(WHOLE)))
    how = told or f"the default car {vehicle.name} (nothing told another)"
    return (
        f"{how}{f', but for {own}' if own else ''}: mass {vehicle.mass:.5g} kg, l_f {vehicle.l_f:.4g} m, "
        f"l_r {vehicle.l_r:.4g} m"
    )
