"""Vehicles written as the TOML files that `VehicleParameters.from_file` reads."""

import json
from dataclasses import fields
from typing import Any

from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.vehicle.parameters import VehicleParameters


def vehicle_toml(vehicle: VehicleParameters, comment: str = "") -> str:
    """The text of a vehicle file; numbers to their last bit, p_ky1 left to the axles' stiffness.

    Args:
        vehicle: What to write; tyre coefficients only where they differ from the default's.
        comment: Lines at the head.
    """
    default = TyreParameters()
    tyre = {f.name: getattr(vehicle.tyre, f.name) for f in fields(TyreParameters) if f.name != "p_ky1"}
    tables = {"tyre": {name: value for name, value in tyre.items() if value != getattr(default, name)}}
    if vehicle.suspension:
        tables["suspension"] = {f.name: getattr(vehicle.suspension, f.name) for f in fields(vehicle.suspension)}
    top = {f.name: getattr(vehicle, f.name) for f in fields(vehicle) if f.name not in ("tyre", "suspension")}
    lines = [f"# {line}" for line in comment.splitlines()] + _rows(top)
    for name, table in tables.items():
        if table:
            lines += ["", f"[{name}]", *_rows(table)]
    return "\n".join(lines) + "\n"


def _rows(table: dict[str, Any]) -> list[str]:
    known = {key: value for key, value in table.items() if value is not None}
    return [f"{key} = {json.dumps(value) if isinstance(value, str) else repr(value)}" for key, value in known.items()]
