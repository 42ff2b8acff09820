"""The `sidestep export` commands: the controller for programs that are not Python."""

import argparse
from pathlib import Path

from sidestep.validation.cli.arguments import add_overrides


def add_export(commands: argparse._SubParsersAction) -> None:
    """Add `export` and what is below it to the commands of `sidestep`."""
    export = commands.add_parser("export", help="write the controller for programs that are not Python")
    below = export.add_subparsers(title="commands", required=True, metavar="COMMAND")
    c = below.add_parser("c", help="header, static and shared library, an example, and the setup of a scenario")
    c.add_argument(
        "scenario", nargs="?", default="double-obstacle", metavar="SCENARIO",
        help="whose car, road and settings stand in controller.setup; default: %(default)s",
    )  # fmt: skip
    c.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the files")
    c.add_argument(
        "--platform", choices=("here", "all"), default="here",
        help="all: libraries for Linux and macOS on x86-64 and ARM and for Windows, by ziglang",
    )  # fmt: skip
    add_overrides(c, "such as controller.period=0.01")
    c.set_defaults(command=_export_c)


def _export_c(options: argparse.Namespace) -> int:
    from sidestep.fmu.compiling.platforms import HOST, all_platforms
    from sidestep.fmu.exporting.library import export_library
    from sidestep.validation.scenarios.scenario import load_scenario

    scene = load_scenario(options.scenario, options.overrides)
    platforms = all_platforms() if options.platform == "all" else (HOST,)
    for file in export_library(options.out, scene.vehicle, scene.path, scene.controller, platforms):
        print(file)
    return 0
