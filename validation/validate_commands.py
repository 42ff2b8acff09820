"""`sidestep validate` and `sidestep identify`."""

import argparse
import time
from pathlib import Path

from sidestep.plant_models.errors import InputError
from sidestep.validation.arguments import add_jobs


def add_validate(commands: argparse._SubParsersAction) -> None:
    """Add `validate` and `identify` to the commands of `sidestep`."""
    validate = commands.add_parser("validate", help="where the models stop predicting a plant, and what proves it")
    _add_plant(validate, "mujoco")
    only = validate.add_mutually_exclusive_group()
    only.add_argument("--manoeuvre", metavar="NAME", help="run this one only; see --manoeuvres")
    only.add_argument("--manoeuvres", action="store_true", help="list them")
    only.add_argument("--checks", action="store_true", help="only the MuJoCo car's own checks")
    validate.add_argument("--quick", action="store_true", help="fewer cells")
    add_jobs(validate)
    validate.add_argument("--out", type=Path, metavar="DIR", help="default: runs/<time>-validate")
    validate.set_defaults(command=_validate)
    identify = commands.add_parser("identify", help="a plant's cornering stiffnesses and yaw inertia")
    _add_plant(identify, "single-track")
    identify.add_argument(
        "--out", type=Path, default=Path("vehicle.toml"), metavar="FILE", help="default: %(default)s"
    )  # fmt: skip
    identify.set_defaults(command=_identify)


def _add_plant(parser: argparse.ArgumentParser, plant: str) -> None:
    kinds = "linear, single-track, double-track, mujoco, or an .fmu file; default: %(default)s"
    parser.add_argument("--plant", default=plant, metavar="PLANT", help=kinds)
    parser.add_argument("--map", type=Path, metavar="MAP.toml", help="mapping file of an FMU that is not ours")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
        help="as of `run`: vehicle.file=car.toml, plant.friction=0.6; may be repeated",
    )  # fmt: skip


def _validate(options: argparse.Namespace) -> int:
    from sidestep.validation.cli import plant_overrides

    if options.manoeuvres:
        from sidestep.validation.manoeuvre_run import list_manoeuvres

        return list_manoeuvres()
    out = options.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-validate"
    overrides = [*options.overrides, *plant_overrides(options)]
    if options.manoeuvre:
        from sidestep.validation.manoeuvre_run import run_manoeuvre

        return run_manoeuvre(options.manoeuvre, overrides, out)
    from sidestep.validation.envelope import open_loop_scenario
    from sidestep.validation.plants import open_plant
    from sidestep.validation.validate import checks_of, evidence_of, write_figures

    if options.checks and options.plant != "mujoco":
        raise InputError("--plant", f"no checks for {options.plant!r}", "mujoco")
    with open_plant(open_loop_scenario(overrides)):
        pass  # a bad key, file or setting shows here, before checks that take minutes
    checks = checks_of(options.plant)
    if checks and options.out:
        write_figures(out)
    if options.checks:
        return 0 if all(check.passed for check in checks) else 1
    from sidestep.validation.plant_report import validate_plant

    return validate_plant(overrides, out, options.command_line, options.jobs, options.quick, evidence_of(checks))


def _identify(options: argparse.Namespace) -> int:
    from sidestep.validation.cli import plant_overrides
    from sidestep.validation.identify import identify_plant

    return identify_plant([*options.overrides, *plant_overrides(options)], options.out, options.command_line)
