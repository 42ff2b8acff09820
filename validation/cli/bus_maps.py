"""`--dbc` and `--map`: whose messages travel on a bus."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sidestep.plant_models.documents import read_toml
from sidestep.plant_models.errors import InputError

if TYPE_CHECKING:
    from sidestep.controller.can_port.codec.catalogue import BusDescription
    from sidestep.validation.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from sidestep.controller.can_port.codec.database import Protection


def add_bus_map(parser: argparse.ArgumentParser, also: str = "") -> None:
    """Add `--dbc` and `--map`."""
    parser.add_argument("--dbc", type=Path, metavar="FILE", help="database of the actuator: .dbc, .kcd, .sym, .arxml")
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="MAP.toml",
        help=f"mapping file of its messages, or its name{also}",
    )


def described(options: argparse.Namespace, scenario: "Scenario | None" = None) -> "BusDescription":
    """What travels on the bus that the options mean.

    Args:
        options: With `dbc`, `map` and, where there is a choice, `protection`.
        scenario: Whose car steers.

    Raises:
        InputError: Mapping file or database cannot be used.
    """
    from sidestep.controller.can_port.codec.catalogue import mapped_bus, own_bus

    maps, _ = split_maps(options.map)
    protection: Protection = getattr(options, "protection", "P02")
    if maps:
        wheelbase = scenario.vehicle.l_f + scenario.vehicle.l_r if scenario else None
        bus = mapped_bus(maps[0], options.dbc, protection, wheelbase)
        if bus.remarks:
            print(f"sidestep: {options.dbc or maps[0]}: read in spite of: {bus.remarks}", file=sys.stderr)
        return bus
    if options.dbc:
        raise InputError("--dbc", "makes no difference without a mapping file", "both, or sidestep can map FILE")
    return own_bus(protection)


def split_maps(maps: Sequence[str]) -> tuple[list[str], list[Path]]:
    """Those of a bus, which have a table [command] or come with the package, and those of an FMU.

    Raises:
        InputError: More than one of either.
    """
    of_bus = [name for name in maps if _is_of_bus(name)]
    of_fmu = [Path(name) for name in maps if name not in of_bus]
    if len(of_bus) > 1 or len(of_fmu) > 1:
        raise InputError("--map", f"{len(maps)} files of one kind", "one of a bus, one of an FMU")
    return of_bus, of_fmu


def _is_of_bus(name: str) -> bool:
    from sidestep.controller.can_port.codec.catalogue import built_in_maps

    if not Path(name).exists():
        return name in built_in_maps()
    try:
        return "command" in read_toml(name)
    except InputError:  # told by who reads it
        return False
