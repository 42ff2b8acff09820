"""The `sidestep limits` commands."""

import argparse
import time
from pathlib import Path

from sidestep.validation.cli.arguments import PLANTS, add_jobs, add_overrides, positive_number, seed, whole_number


def add_limits(commands: argparse._SubParsersAction) -> None:
    """Add `limits` and what is below it to the commands of `sidestep`."""
    limits = commands.add_parser("limits", help="how far the controller goes: speed, delay, random scenes, a day")
    below = limits.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for add in (_add_moose, _add_scenes, _add_optimum, _add_delay, _add_endurance, _add_alks):
        add(below)


def _add(below: argparse._SubParsersAction, name: str, text: str, plant: str | None) -> argparse.ArgumentParser:
    parser = below.add_parser(name, help=text)
    default = {"default": plant, "help": f"{PLANTS}; default: %(default)s"}
    if plant is None:
        default = {"help": "only this one; default: single-track and mujoco"}
    parser.add_argument("--plant", metavar="PLANT", **default)
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"default: runs/<time>-{name}")
    add_overrides(parser, "such as controller.tyre_model=linear")
    return parser


def _add_moose(below: argparse._SubParsersAction) -> None:
    moose = _add(below, "moose", "ISO 3888-2: the highest clean entry speed, throttle off", None)
    add_jobs(moose)
    moose.set_defaults(command=_moose)


def _add_scenes(below: argparse._SubParsersAction) -> None:
    scenes = _add(below, "scenes", "random scenes against what physics allows", "single-track")
    scenes.add_argument("--count", type=whole_number, default=1000, metavar="N", help="scenes; default: %(default)s")
    scenes.add_argument("--seed-from", type=seed, default=0, metavar="K", help="first seed; default: %(default)s")
    add_jobs(scenes)
    scenes.set_defaults(command=_scenes)


def _add_optimum(below: argparse._SubParsersAction) -> None:
    best = _add(below, "optimum", "peaks in the paper's scenes against the offline optimum", None)
    best.set_defaults(command=_optimum)


def _add_delay(below: argparse._SubParsersAction) -> None:
    delay = _add(below, "delay", "one step of delay, with and without compensation", "single-track")
    delay.set_defaults(command=_delay)


def _add_endurance(below: argparse._SubParsersAction) -> None:
    endurance = _add(below, "endurance", "a day of driving on a closed road among random obstacles", "single-track")
    endurance.add_argument(
        "--hours", type=positive_number, default=24.0, metavar="H", help="simulated; default: %(default)s"
    )
    endurance.add_argument("--seed-from", type=seed, default=0, metavar="K", help="first seed; default: %(default)s")
    endurance.set_defaults(command=_endurance)


def _add_alks(below: argparse._SubParsersAction) -> None:
    alks = _add(below, "alks", "OpenSCENARIO files against drivers who only brake (UN R157)", "single-track")
    alks.add_argument("files", nargs="+", type=Path, metavar="FILE", help=".xosc files, or folders of them")
    alks.add_argument(
        "--count", type=whole_number, default=20, metavar="N", help="variations of each file; default: %(default)s"
    )
    add_jobs(alks)
    alks.set_defaults(command=_alks)


def _moose(options: argparse.Namespace) -> int:
    from sidestep.validation.studies.moose import moose

    plants = (options.plant,) if options.plant else ("single-track", "mujoco")
    return moose(plants, options.overrides, options.jobs, _folder(options, "moose"), options.command_line)


def _scenes(options: argparse.Namespace) -> int:
    from sidestep.validation.studies.scenes import scenes

    seeds = range(options.seed_from, options.seed_from + options.count)
    return scenes(
        seeds, options.plant, options.overrides, options.jobs, _folder(options, "scenes"), options.command_line
    )


def _optimum(options: argparse.Namespace) -> int:
    from sidestep.validation.studies.optimum import optimum

    plants = (options.plant,) if options.plant else ("single-track", "mujoco")
    return optimum(plants, options.overrides, _folder(options, "optimum"), options.command_line)


def _delay(options: argparse.Namespace) -> int:
    from sidestep.validation.studies.delay import delay

    return delay(options.plant, options.overrides, _folder(options, "delay"), options.command_line)


def _endurance(options: argparse.Namespace) -> int:
    from sidestep.validation.studies.endurance import endurance

    return endurance(
        options.hours, options.seed_from, options.plant, options.overrides, _folder(options, "endurance"),
        options.command_line,
    )  # fmt: skip


def _alks(options: argparse.Namespace) -> int:
    from sidestep.validation.studies.alks import alks

    return alks(
        options.files, options.plant, options.overrides, options.count, options.jobs, _folder(options, "alks"),
        options.command_line,
    )  # fmt: skip


def _folder(options: argparse.Namespace, name: str) -> Path:
    return options.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}"
