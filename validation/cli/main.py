"""The `sidestep` command: one function per subcommand, heavy imports only in the one that runs.

Exit status: 0 pass, 1 the run ended and its verdict is fail or inconclusive (or nobody reads what it prints any more),
2 bad input or usage (or an error that nobody foresaw), 130 interrupted or terminated.
"""

import argparse
import json
import os
import shlex
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.validation.cli.arguments import PLANTS, add_overrides, positive_number
from sidestep.validation.cli.bus_maps import add_bus_map, described, split_maps
from sidestep.validation.cli.campaign import add_campaign
from sidestep.validation.cli.can import add_can
from sidestep.validation.cli.compare import add_compare, add_golden
from sidestep.validation.cli.export import add_export
from sidestep.validation.cli.fmu import add_fmu
from sidestep.validation.cli.limits import add_limits
from sidestep.validation.cli.scenarios import add_import, add_scenarios
from sidestep.validation.cli.shell.completion import add_completion
from sidestep.validation.cli.shell.last_resort import one_line, unforeseen
from sidestep.validation.cli.shell.parser import BAD_INPUT, Parser
from sidestep.validation.cli.validate import add_validate
from sidestep.validation.cli.vehicles import add_vehicles
from sidestep.validation.interrupt import terminated_as_interrupted
from sidestep.validation.shown import shown

FAILED, INTERRUPTED = 1, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; `argv` without the program's name, None for the process's own.

    Returns:
        The exit status.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    with shown():
        return _ended(arguments)


def _ended(arguments: Sequence[str]) -> int:
    try:
        try:
            return _status(arguments)
        finally:
            sys.stdout.flush()
    except OSError as error:  # files are looked after where they are written: this is the output, or a full disk
        if error.filename is None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the interpreter tries again at its end
        if isinstance(error, BrokenPipeError):
            return FAILED
        print(f"sidestep: {error.filename or 'output'}: {error.strerror}", file=sys.stderr)
        return BAD_INPUT


def _status(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    options.command_line = shlex.join(["sidestep", *arguments])
    try:
        with terminated_as_interrupted():
            return _done(options)
    except (InputError, PlantError) as error:
        print(f"sidestep: {one_line(str(error))}", file=sys.stderr)
    except KeyboardInterrupt:
        print("sidestep: interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:  # the last resort
        if isinstance(error, OSError) and error.errno is not None:
            raise
        print(f"sidestep: {unforeseen(error, arguments)}", file=sys.stderr)
    return BAD_INPUT


def _done(options: argparse.Namespace) -> int:
    if any("\ud800" <= letter <= "\udfff" for letter in options.command_line):  # bytes that are no UTF-8
        raise InputError("arguments", f"{options.command_line!a} cannot be read", "UTF-8")
    return options.command(options)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="sidestep", description="Obstacle avoidance by corridor planning and MPC, on plants and on CAN."
    )
    parser.add_argument("--version", action="version", version=version("sidestep"))
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    own = (_add_demo, _add_run, add_scenarios, add_import, add_vehicles, add_validate, add_campaign, _add_bench)
    for add in (*own, add_compare, add_golden, add_limits, add_fmu, add_export, add_can):
        add(commands)
    add_completion(commands, parser)
    return parser


def _add_demo(commands: argparse._SubParsersAction) -> None:
    demo = commands.add_parser("demo", help="the paper's two scenes on three plants, steering on CAN, with a report")
    demo.add_argument("--out", type=Path, default=Path("sidestep-demo"), metavar="DIR", help="default: %(default)s")
    demo.set_defaults(command=_demo)


def _add_run(commands: argparse._SubParsersAction) -> None:
    run = commands.add_parser("run", help="drive one scenario")
    what = run.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "scenario",
        nargs="?",
        metavar="SCENARIO",
        help="a name that `sidestep scenarios` lists, a TOML file, a CommonRoad .xml or an OpenSCENARIO .xosc file",
    )
    what.add_argument("--from", dest="row", metavar="FILE.jsonl:ROW", help="a row of a campaign, exactly as it was")
    run.add_argument("--plant", metavar="PLANT", help=PLANTS)
    run.add_argument(
        "--controller", metavar="MODULE:FACTORY", help="a controller of your own, with ours to take over; default: ours"
    )
    add_bus_map(run, "; and that of an FMU or a MuJoCo model that is not ours")
    run.add_argument(
        "--isolate", type=positive_number, nargs="?", const=5.0, metavar="SECONDS",
        help="run an FMU in a process of its own, with this time limit a step (default: %(const)s)",
    )  # fmt: skip
    run.add_argument(
        "--accept-start", action="store_true",
        help="drive a plant that does not start where it is put from where it does; the summary tells both",
    )  # fmt: skip
    run.add_argument("--can", metavar="BUS", help="auto (default), off (default with --from), or INTERFACE:CHANNEL")
    run.add_argument("--allow-real-bus", action="store_true", help="let that bus reach hardware")
    run.add_argument(
        "--coupling", default="zero-delay", choices=("zero-delay", "one-step-delay"), help="default: %(default)s"
    )
    run.add_argument("--out", type=Path, metavar="DIR", help="default: runs/<time>-<scenario>")
    run.add_argument("--mf4", action="store_true", help="also write recording.mf4; needs the extra mdf")
    run.add_argument("--junit", type=Path, metavar="FILE", help="also write the verdict as a test case")
    add_overrides(run, "such as plant.friction=0.6")
    run.add_argument("--view", action="store_true", help="show MuJoCo's viewer, in real time")
    run.add_argument("--render", type=Path, metavar="FILE", help="film MuJoCo's car, as .gif or .mp4; needs no display")
    run.set_defaults(command=_run)


def _add_bench(commands: argparse._SubParsersAction) -> None:
    bench = commands.add_parser("bench", help="measure controller, plants and CAN")
    bench.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    bench.add_argument("--solvers", action="store_true", help="compare QP solvers, too")
    bench.set_defaults(command=_bench)


def _demo(options: argparse.Namespace) -> int:
    from sidestep.validation.studies.demo import demo

    return demo(options.out, options.command_line)


def _bench(options: argparse.Namespace) -> int:
    from sidestep.validation.studies.bench import main as bench

    return bench(options)


def _run(options: argparse.Namespace) -> int:
    from sidestep.validation.scenarios.library import read_scenario

    if options.row is None:
        read_scenario(options.scenario)  # a mistyped name need not wait for all that is below
    from sidestep.validation.cli.campaign import compared_to_row, replayed
    from sidestep.validation.console import print_runs, progress_bar, warn
    from sidestep.validation.files import check_file
    from sidestep.validation.loop.foreign import plant_doubts
    from sidestep.validation.report.exports.junit import write_junit
    from sidestep.validation.report.exports.mdf import require_mdf, write_mdf
    from sidestep.validation.report.report import junit_case, write_run
    from sidestep.validation.scenarios.scenario import load_scenario
    from sidestep.validation.studies.runs import drive

    isolated = [] if options.isolate is None else [f"plant.isolate={options.isolate}"]
    accepted = ["plant.accept_start=true"] if options.accept_start else []
    changes = [*options.overrides, *plant_overrides(options), *isolated, *accepted]
    row, can = None, ("off" if options.row else "auto") if options.can is None else options.can
    if options.row is not None:
        scenario, row = replayed(options.row, changes)
    else:
        scenario = load_scenario(options.scenario, changes)
    folder = options.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{scenario.name}"
    if options.mf4:
        require_mdf()
    check_file(options.junit, "--junit")
    check_file(options.render, "--render")
    warn(plant_doubts(scenario))
    with progress_bar(f"{scenario.name} on {scenario.plant.name}", scenario.duration) as progress:
        run = drive(
            scenario, folder, can, options.coupling, options.allow_real_bus, options.view, progress,
            options.command_line, options.render, described(options, scenario).messages["STEER_CMD"],
        )  # fmt: skip
        write_run(run)
    if options.mf4:
        write_mdf(folder / "recording.mf4", run.recording, f"{scenario.name} on {scenario.plant.name}")
    if options.junit:
        write_junit(options.junit, "sidestep run", [junit_case(run)])
    print_runs([run.summary])
    if row:
        print(compared_to_row(run, row))
    for note in scenario.notes:
        print(f"note: {note}")
    print(f"report: {folder / 'report.html'}")
    if run.interrupted:
        raise KeyboardInterrupt
    return 0 if run.judgement.passed else 1


def plant_overrides(options: argparse.Namespace) -> list[str]:
    """What `--plant` and `--map` change in the scenario file."""
    from sidestep.validation.scenarios.plant_settings import FILES

    overrides = []
    if options.plant is not None:
        plant = str(Path(options.plant).absolute()) if options.plant.endswith(FILES) else options.plant
        overrides.append(f"plant.kind={json.dumps(plant)}")
    if getattr(options, "controller", None) not in (None, "default"):
        overrides.append(f"controller.kind={json.dumps(options.controller)}")
    given = options.map if isinstance(options.map, list) else [options.map] if options.map else []
    _, maps = split_maps([str(name) for name in given])
    if maps:
        overrides.append(f"plant.map={json.dumps(str(maps[0].absolute()))}")
    return overrides
