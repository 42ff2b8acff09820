"""`sidestep can ...`: the two nodes, monitor, replay, faults and the database."""

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.arguments import PLANTS, add_overrides, positive_number, refuse_beside, seed, whole_number
from sidestep.validation.cli.bus_maps import add_bus_map, described

if TYPE_CHECKING:
    from sidestep.controller.can_port.bus.bus import Bus


_CASES, _CORRUPT = 500, 1_000_000
"""Of `can faults`: cases, and corrupt frames."""


def add_can(commands: argparse._SubParsersAction) -> None:
    """Add the subcommands of `can`."""
    can = commands.add_parser("can", help="nodes, monitor, replay, faults and database of the CAN bus")
    parts = can.add_subparsers(title="commands", required=True, metavar="COMMAND")
    drive = _node(parts, "drive", "the controller as a node: state in, steering out, every 10 ms", _drive)
    plant = _node(parts, "plant", "plant, steering actuator and sensors as a node", _plant)
    plant.add_argument("--plant", metavar="PLANT", help=PLANTS)
    plant.set_defaults(isolate=None)
    for part in (drive, plant):
        add_overrides(part, "such as speed=12")
    monitor = parts.add_parser("monitor", help="decoded signals with their E2E state, live")
    _bus_options(monitor)
    until = monitor.add_mutually_exclusive_group()
    until.add_argument("--once", action="store_true", help="one table after a second")
    until.add_argument("--duration", type=positive_number, metavar="S", help="end after so many seconds")
    monitor.add_argument("--candump", metavar="FILE", help="write what candump -L would; - for the terminal")
    monitor.add_argument("--log", type=Path, metavar="FILE", help="log to .blf, .asc, .log or .csv")
    monitor.add_argument("--overwrite", action="store_true", help="these files may be there already")
    monitor.set_defaults(command=_monitor)
    replay = parts.add_parser("replay", help="a log as plant on a bus, or what the controller would have sent")
    replay.add_argument(
        "log", type=Path, metavar="LOG", help=".blf, .asc, .log, .csv, .trc, .mf4 or .db, each also as .gz"
    )
    replay.add_argument("--channel", metavar="NAME", help="the only channel of the log that counts; default: all")
    replay.add_argument("--speed", type=positive_number, metavar="X", help="X times as fast as recorded")
    replay.add_argument("--loop", type=whole_number, metavar="N", help="send it N times")
    replay.add_argument("--gap", type=positive_number, metavar="S", help="shorten pauses to S seconds (default: 3600)")
    replay.add_argument("--what-if", metavar="SCENARIO", help="ask this scenario's controller instead of sending")
    replay.add_argument("--out", type=Path, metavar="DIR", help="of --what-if; default: what-if")
    _bus_options(replay)
    replay.set_defaults(command=_replay)
    faults = parts.add_parser("faults", help="seeded faults in virtual time: does anything unsafe pass?")
    faults.add_argument("--count", type=whole_number, metavar="N", help=f"cases (default: {_CASES})")
    faults.add_argument("--corrupt", type=whole_number, metavar="N", help=f"default: {_CORRUPT} frames")
    faults.add_argument("--seed", type=seed, help="of the first case (default: 0)")
    faults.add_argument("--spec", type=Path, metavar="FAULTS.toml", help="one description instead of the cases")
    faults.set_defaults(command=_faults)
    proposal = parts.add_parser("map", help="propose a mapping file for somebody else's database")
    proposal.add_argument("file", nargs="?", type=Path, metavar="FILE", help=".dbc, .kcd, .sym or .arxml")
    proposal.add_argument("--list", action="store_true", help="the mapping files that come with sidestep")
    proposal.add_argument("--out", type=Path, metavar="BUS.toml", help="write it there; default: to the terminal")
    proposal.set_defaults(command=_map)
    dbc = parts.add_parser("dbc", help="the message database, to stdout")
    dbc.add_argument("--format", default="dbc", choices=("dbc", "kcd", "sym", "json"), help="default: %(default)s")
    _protection_options(dbc)
    dbc.set_defaults(command=_dbc)


def _node(parts: argparse._SubParsersAction, name: str, words: str, command: Any) -> argparse.ArgumentParser:
    node = parts.add_parser(name, help=words)
    node.add_argument("scenario", metavar="SCENARIO", help="a name that `sidestep scenarios` lists, or a TOML file")
    node.add_argument("--out", type=Path, metavar="DIR", help="default: runs/<time>-<scenario>")
    node.add_argument("--log", default="can.blf", metavar="NAME", help="log file in it (.blf, .asc, .log, .csv)")
    _bus_options(node, "; and, of the plant, that of a foreign FMU" if name == "plant" else "")
    node.set_defaults(command=command)
    return node


def _bus_options(parser: argparse.ArgumentParser, also: str = "") -> None:
    add_bus_map(parser, also)
    parser.add_argument(
        "--can", default="auto", metavar="BUS", help="auto (default), udp_multicast:GROUP:PORT, socketcan:vcan0"
    )
    parser.add_argument("--allow-real-bus", action="store_true", help="let that bus reach hardware")
    _protection_options(parser)


def _protection_options(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument(
        "--fd", dest="protection", action="store_const", const="P05", default="P02", help="CAN FD with E2E profile 5"
    )
    kinds.add_argument("--no-e2e", dest="protection", action="store_const", const="none", help="no protection")


def _shared_bus(options: argparse.Namespace, everything: bool = False) -> "Bus":
    from sidestep.controller.can_port.bus.bus import Bus, resolve_spec

    _require_shared(options)
    spec = resolve_spec(options.can, several_processes=True)
    fd = everything or any(message.is_fd for message in described(options).messages.values())
    listens = everything  # the monitor, which sends nothing
    return Bus(spec, fd=fd, allow_real_bus=options.allow_real_bus or listens, everything=everything)


def _require_shared(options: argparse.Namespace) -> None:
    if options.can == "off" or options.can.startswith("virtual"):
        raise InputError("--can", f"{options.can!r} does not reach another process", "auto, udp_multicast, socketcan")


def _folder(options: argparse.Namespace, name: str) -> Path:
    return options.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}"


def _drive(options: argparse.Namespace) -> int:
    from sidestep.validation.can_bus.drive import run_controller
    from sidestep.validation.files import write_text, written_to
    from sidestep.validation.judge.summary import strict_json
    from sidestep.validation.scenarios.scenario import load_scenario

    _require_shared(options)
    for key in (change.partition("=")[0].strip() for change in options.overrides):
        if f"{key}.".startswith("plant."):
            raise InputError(f"--set {key}", "makes no difference at the controller's end", "sidestep can plant")
    scenario = load_scenario(options.scenario, options.overrides)
    bus = described(options, scenario)
    folder = _folder(options, f"{scenario.name}-controller")
    figures = run_controller(scenario, folder, options.can, bus, options.log, options.allow_real_bus)
    with written_to(folder):
        said = {name: figures.pop(name) for name in ("verdict", "label", "findings")}
        summary = {"scenario": scenario.name, "command_line": options.command_line, **said, "can": figures}
        write_text(folder / "summary.json", strict_json(summary))
    print(f"{said['verdict']}: {said['label']}")
    for finding in said["findings"]:
        print(f"{finding['label']}: {finding['text']}")
    print(_timing(figures))
    print(f"log: {folder / options.log}")
    if figures["interrupted"]:
        raise KeyboardInterrupt
    return 0 if said["verdict"] == "pass" else 1


def _plant(options: argparse.Namespace) -> int:
    from sidestep.validation.can_bus.drive import run_plant
    from sidestep.validation.cli.main import plant_overrides
    from sidestep.validation.console import print_runs, progress_bar
    from sidestep.validation.report.report import write_run
    from sidestep.validation.scenarios.scenario import load_scenario

    _require_shared(options)
    scenario = load_scenario(options.scenario, [*options.overrides, *plant_overrides(options)])
    bus = described(options, scenario)
    folder = _folder(options, scenario.name)
    bar = progress_bar(f"{scenario.name} on {scenario.plant.name}", scenario.duration)
    with bar as progress:
        run = run_plant(
            scenario, folder, options.can, bus, options.log, options.allow_real_bus, progress,
            options.command_line,
        )  # fmt: skip
    write_run(run)
    print_runs([run.summary])
    print(_timing(run.summary["can"]))
    print(f"report: {folder / 'report.html'}")
    if run.interrupted:
        raise KeyboardInterrupt
    return 0 if run.judgement.passed else 1


def _timing(figures: dict[str, Any]) -> str:
    late = figures["lateness_ms"]
    text = (
        f"{figures['interface']}: {figures['sent']} frames sent, {figures['refused']} refused, {figures['lost']} lost; "
        f"{figures['cycles']} cycles, {figures['skipped']} skipped, lateness p50 {late['p50']:.2f} ms, "
        f"p99 {late['p99']:.2f} ms, max {late['max']:.2f} ms, drift {100.0 * figures['drift']:+.4f} %"
    )
    share = figures.get("processor_share")
    return text if share is None else f"{text}, {100.0 * share:.1f} % of a core"


def _monitor(options: argparse.Namespace) -> int:
    from sidestep.validation.can_bus.monitor import monitor

    if options.overwrite and not (options.log or options.candump not in (None, "-")):
        raise InputError("--overwrite", "makes no difference without a file", "--candump FILE or --log FILE")
    duration = 1.0 if options.once else options.duration
    with _shared_bus(options, everything=True) as bus:
        monitor(bus, described(options), duration, options.candump, options.log, options.overwrite)
    return 0


def _replay(options: argparse.Namespace) -> int:
    from sidestep.validation.can_bus.replay import LONGEST_PAUSE, Pace, replay_as_plant, what_if
    from sidestep.validation.scenarios.scenario import load_scenario

    if options.what_if:
        refuse_beside(
            "--what-if",
            {"--can": None if options.can == "auto" else options.can, "--allow-real-bus": options.allow_real_bus},
        )
        scenario = load_scenario(options.what_if)
        bus = described(options, scenario)
        return what_if(options.log, scenario, options.out or Path("what-if"), bus, options.channel)
    if options.out:
        raise InputError("--out", "makes no difference without --what-if", "both, or neither")
    with _shared_bus(options) as bus:
        pace = Pace(options.speed or 1.0, options.loop or 1, options.gap or LONGEST_PAUSE)
        sent = replay_as_plant(options.log, bus, described(options), options.channel, pace)
        print(f"{sent} frames sent on {bus.spec}")
    return 0


def _faults(options: argparse.Namespace) -> int:
    from sidestep.validation.can_bus.faults import campaign, one_case

    if options.spec:
        others = {"--count": options.count, "--corrupt": options.corrupt, "--seed": options.seed}
        refuse_beside("--spec", others)
        return one_case(options.spec)
    return campaign(options.count or _CASES, options.corrupt or _CORRUPT, options.seed or 0)


def _map(options: argparse.Namespace) -> int:
    if options.list == (options.file is not None):
        raise InputError("can map", "one thing at a time", "FILE, or --list")
    from sidestep.controller.can_port.codec.catalogue import built_in_maps, map_file
    from sidestep.controller.can_port.codec.foreign import load_database
    from sidestep.controller.can_port.codec.mapping import read_bus_file
    from sidestep.controller.can_port.codec.proposal import proposed
    from sidestep.validation.files import write_text

    if options.list:
        refuse_beside("--list", {"--out": options.out})
        for name in built_in_maps():
            file = read_bus_file(map_file(name))
            print(f"{name:16}{file.name}{'' if file.dbc else '; needs --dbc'}")
        return 0
    database, remarks = load_database(options.file)
    if remarks:
        print(f"sidestep: {options.file}: read in spite of: {remarks}", file=sys.stderr)
    text = proposed(database, options.file)
    if options.out is None:
        print(text, end="")
    else:
        if options.out.exists():
            raise InputError(str(options.out), "is there already", "another name")
        write_text(options.out, text)
    return 0


def _dbc(options: argparse.Namespace) -> int:
    from sidestep.controller.can_port.codec.export import exported

    print(exported(options.format, options.protection), end="")
    return 0
