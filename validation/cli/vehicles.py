"""`sidestep vehicles`: the cars that come with the package, what is known of each, and several side by side."""

import argparse
from pathlib import Path


def add_vehicles(commands: argparse._SubParsersAction) -> None:
    """Add `vehicles` to the commands of `sidestep`."""
    text = "list the cars that `vehicle.preset` takes; show or compare those named"
    vehicles = commands.add_parser("vehicles", help=text, description=f"{text}. ~ marks what is estimated.")
    vehicles.add_argument("cars", nargs="*", metavar="CAR", help="one: every number and its source; more: side by side")
    vehicles.add_argument("--find", metavar="TEXT", help="list only cars whose name contains it")
    vehicles.add_argument(
        "--tyre", type=Path, metavar="FILE.tir", help="a tyre property file as it is read, and what of it is not used"
    )
    vehicles.set_defaults(command=_vehicles)


def _vehicles(options: argparse.Namespace) -> int:
    from sidestep.validation.cli.vehicle_tables import show_vehicles

    return show_vehicles(options)
