"""`sidestep validate` and `sidestep identify`."""

import argparse
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.arguments import PLANTS, add_jobs, add_overrides, refuse_beside


def add_validate(commands: argparse._SubParsersAction) -> None:
    """Add `validate` and `identify` to the commands of `sidestep`."""
    validate = commands.add_parser("validate", help="where the models stop predicting a plant, and what proves it")
    _add_plant(validate, "mujoco")
    only = validate.add_mutually_exclusive_group()
    only.add_argument("--manoeuvre", metavar="NAME", help="run this one only; see --manoeuvres")
    only.add_argument("--manoeuvres", action="store_true", help="list them")
    only.add_argument("--checks", action="store_true", help="only the MuJoCo car's own checks")
    _add_log(validate)
    validate.add_argument(
        "--identified",
        type=Path,
        metavar="FILE.json",
        help="of --log: what `identify --log` wrote; else this log is split",
    )
    validate.add_argument("--quick", action="store_true", help="fewer cells")
    add_jobs(validate)
    validate.add_argument("--out", type=Path, metavar="DIR", help="default: runs/<time>-validate")
    validate.add_argument("--junit", type=Path, metavar="FILE", help="also write every verdict as a test case")
    validate.set_defaults(command=_validate)
    identify = commands.add_parser("identify", help="a car's parameters, from a plant or a measured log")
    _add_plant(identify, "single-track")
    _add_log(identify)
    identify.add_argument(
        "--out", type=Path, default=Path("vehicle.toml"), metavar="FILE", help="default: %(default)s"
    )  # fmt: skip
    identify.set_defaults(command=_identify)


def _add_plant(parser: argparse.ArgumentParser, plant: str) -> None:
    parser.add_argument("--plant", default=plant, metavar="PLANT", help=f"{PLANTS}; default: %(default)s")
    parser.add_argument("--map", type=Path, metavar="MAP.toml", help="mapping file of an FMU or a log that is not ours")
    parser.set_defaults(default_plant=plant)
    add_overrides(parser, "of vehicle and plant: vehicle.file=car.toml, plant.stiffness=0.9")


def _add_log(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--log",
        type=Path,
        metavar="FILE",
        help="a measured log instead of a plant: .csv, .mf4, .parquet, or CAN frames",
    )


def _refuse_beside_log(options: argparse.Namespace, others: dict[str, Any]) -> None:
    plant = None if options.plant == options.default_plant else options.plant
    refuse_beside("--log", {"--plant": plant} | others)


def _validate(options: argparse.Namespace) -> int:
    from sidestep.validation.cli.main import plant_overrides
    from sidestep.validation.files import check_file, made

    given = {"--junit": options.junit, "--out": options.out}
    cells = {"--quick": options.quick, "--jobs": options.jobs}
    changes = {"--set": options.overrides, "--map": options.map}
    if options.manoeuvres:
        from sidestep.validation.manoeuvres.manoeuvre_run import list_manoeuvres

        refuse_beside("--manoeuvres", given | cells | changes)
        return list_manoeuvres()
    if options.log is not None:
        from sidestep.validation.model_error.measured.commands import validate_log

        only = {"--manoeuvre": options.manoeuvre, "--checks": options.checks, "--junit": options.junit}
        _refuse_beside_log(options, only | cells)
        folder = options.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-validate"
        return validate_log(
            options.log, options.map, options.identified, options.overrides, folder, options.command_line
        )  # fmt: skip
    refuse_beside("--plant", {"--identified": options.identified})
    check_file(options.junit, "--junit")
    out = options.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-validate"
    overrides = [*options.overrides, *plant_overrides(options)]
    if options.manoeuvre is not None:
        from sidestep.validation.manoeuvres.catalogue import MANOEUVRES
        from sidestep.validation.manoeuvres.manoeuvre_run import run_manoeuvre

        unused = "--junit" if options.manoeuvre in MANOEUVRES else "--out"
        refuse_beside(f"--manoeuvre {options.manoeuvre}", cells | {unused: given[unused]})
        return run_manoeuvre(options.manoeuvre, overrides, out, options.junit)
    from sidestep.validation.console import warn
    from sidestep.validation.loop.foreign import plant_doubts
    from sidestep.validation.manoeuvres.scene import open_loop_scenario
    from sidestep.validation.model_error.envelope import frictions_of
    from sidestep.validation.model_error.plant_report import validate_plant
    from sidestep.validation.model_error.validate import checks_of, junit_cases, write_figures
    from sidestep.validation.report.exports.junit import write_junit

    if options.checks:
        refuse_beside("--checks", cells | changes)
        if options.plant != "mujoco":
            raise InputError("--plant", f"no checks for {options.plant!r}", "mujoco")
    else:
        scenario = open_loop_scenario(overrides)
        frictions_of(scenario)  # what is wrong shows here, before checks that take minutes
        warn(plant_doubts(scenario))
    with made(out) if options.out or not options.checks else nullcontext():
        checks = checks_of(options.plant)
    if checks and options.out:
        write_figures(out)
    if not options.checks:
        return validate_plant(overrides, out, options.command_line, options.jobs, options.quick, checks, options.junit)
    if options.junit:
        write_junit(options.junit, "sidestep validate", junit_cases(checks))
    return 0 if all(check.passed for check in checks) else 1


def _identify(options: argparse.Namespace) -> int:
    from sidestep.validation.cli.main import plant_overrides
    from sidestep.validation.console import warn
    from sidestep.validation.loop.foreign import plant_doubts
    from sidestep.validation.manoeuvres.scene import open_loop_scenario
    from sidestep.validation.model_error.identification.identify import identify_plant

    if options.log is not None:
        from sidestep.validation.model_error.measured.commands import identify_from_log

        _refuse_beside_log(options, {"--set": options.overrides})
        return identify_from_log(options.log, options.map, options.out, options.command_line)
    overrides = [*options.overrides, *plant_overrides(options)]
    warn(plant_doubts(open_loop_scenario(overrides, noisy=True)))
    return identify_plant(overrides, options.out, options.command_line)
