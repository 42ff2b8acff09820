"""Runs the controller of this FMU; started by its binary, see sidestep.fmu.exporting.controller_server."""

from pathlib import Path

from sidestep.fmu.exporting.controller_server import main

main(Path(__file__).parent)
