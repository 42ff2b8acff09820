"""The `sidestep fmu` commands."""

import argparse
from pathlib import Path

from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.arguments import add_overrides


def add_fmu(commands: argparse._SubParsersAction) -> None:
    """Add `fmu` and what is below it to the commands of `sidestep`."""
    fmu = commands.add_parser("fmu", help="build, export, inspect and check FMUs")
    below = fmu.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for add in (_add_build, _add_export, _add_info, _add_check):
        add(below)


def _add_build(commands: argparse._SubParsersAction) -> None:
    build = commands.add_parser("build", help="make an FMU of a plant")
    build.add_argument("model", metavar="MODEL", help="single-track, double-track or linear")
    build.add_argument("--fmi", type=int, default=3, choices=(2, 3), help="default: %(default)s")
    build.add_argument("--out", type=Path, metavar="FILE", help="default: MODEL.fmu")
    build.add_argument(
        "--platform", choices=("here", "all"), default="here",
        help="all: binaries for Linux and macOS on x86-64 and ARM and for Windows in one FMU, by ziglang",
    )  # fmt: skip
    build.set_defaults(command=_build)


def _add_export(commands: argparse._SubParsersAction) -> None:
    export = commands.add_parser("export", help="make an FMU of the controller of a scenario")
    export.add_argument("scenario", metavar="SCENARIO", help="a name that `sidestep scenarios` lists, or a TOML file")
    export.add_argument("--fmi", type=int, choices=(2, 3), help="default: 3")
    export.add_argument(
        "--platform", choices=("here", "all"), default="here",
        help="all: binaries for Linux and macOS on x86-64 and ARM and for Windows in one FMU, by ziglang",
    )  # fmt: skip
    export.add_argument("--out", type=Path, metavar="FILE", help="default: SCENARIO-controller.fmu, or SCENARIO.ssp")
    export.add_argument(
        "--ssp", action="store_true",
        help="a system (.ssp) of controller and plant instead, in FMI 2.0; single-track where the scenario's plant is "
        "no model of `build`",
    )  # fmt: skip
    add_overrides(export, "such as controller.input_delay_steps=1")
    export.set_defaults(command=_export)


def _add_info(commands: argparse._SubParsersAction) -> None:
    info = commands.add_parser("info", help="variables and capabilities of an FMU, and a mapping for it")
    info.add_argument("file", type=Path, metavar="FILE")
    info.add_argument("--map", type=Path, metavar="MAP.toml", help="write the proposed mapping there")
    info.set_defaults(command=_info)


def _add_check(commands: argparse._SubParsersAction) -> None:
    check = commands.add_parser("check", help="what is wrong with an FMU: ours, fmpy's and fmutool's findings")
    check.add_argument("file", type=Path, metavar="FILE")
    check.add_argument(
        "--map", type=Path, metavar="MAP.toml",
        help="also drive it by this mapping: signs, units, ratios, reference point, and the car of its [vehicle]",
    )  # fmt: skip
    check.set_defaults(command=_check)


def _build(options: argparse.Namespace) -> int:
    from sidestep.fmu.native.build import build_fmu
    from sidestep.validation.files import check_file

    out = options.out or Path(f"{options.model}.fmu")
    check_file(out, "--out")
    print(build_fmu(options.model, options.fmi, out, everywhere=options.platform == "all"))
    return 0


def _export(options: argparse.Namespace) -> int:
    from sidestep.fmu.compiling.platforms import HOST, all_platforms
    from sidestep.fmu.description.plants import MODELS
    from sidestep.fmu.exporting.export import export_controller, start_plant
    from sidestep.fmu.exporting.ssp import write_ssp
    from sidestep.fmu.native.build import write_to
    from sidestep.validation.files import check_file
    from sidestep.validation.scenarios.plant_settings import PlantSettings
    from sidestep.validation.scenarios.scenario import load_scenario

    check_file(options.out, "--out")
    scene = load_scenario(options.scenario, options.overrides)
    if options.ssp:
        if options.platform == "all":
            raise InputError("--platform", "all: the system's plant is built for this machine", "here")
        if options.fmi == 3:
            raise InputError("--fmi", "3: a system is of FMI 2.0, which every master opens", "2")
        if scene.plant != PlantSettings(scene.plant.kind, scene.plant.friction):
            raise InputError("plant", "the system's plant is that of `fmu build`", "plant.kind and plant.friction")
    elif any(change.startswith("plant") for change in options.overrides):
        raise InputError("--set plant", "makes no difference to the controller", "with --ssp")
    fmi = 2 if options.ssp else options.fmi or 3
    controller = export_controller(
        scene.name, scene.vehicle, scene.path, scene.obstacles, scene.controller, scene.start, fmi,
        all_platforms() if options.platform == "all" else (HOST,),
    )  # fmt: skip
    if options.ssp:
        out = options.out or Path(f"{scene.name}.ssp")
        kind = scene.plant.kind if scene.plant.kind in MODELS else "single-track"
        plant = start_plant(kind, scene.vehicle, scene.start, scene.plant.friction, fmi)
        print(write_ssp(out, scene.name, controller, plant, scene.duration, scene.controller.period))
    else:
        print(write_to(options.out or Path(f"{scene.name}-controller.fmu"), controller.read_bytes()))
    return 0


def _info(options: argparse.Namespace) -> int:
    from sidestep.fmu.importing.archive import describe_fmu
    from sidestep.fmu.importing.proposal import describe, propose_mapping
    from sidestep.validation.files import check_file, write_text, written_file

    check_file(options.map, "--map")
    fmu = describe_fmu(options.file)
    text, proposal = describe(fmu), propose_mapping(fmu, options.file)
    print(f"{text}\n\n{proposal}", end="")
    if options.map:
        with written_file(options.map, "--map"):
            write_text(options.map, proposal)
    return 0


def _check(options: argparse.Namespace) -> int:
    from sidestep.fmu.importing.checks.findings import check_fmu

    if not options.file.is_file():
        raise InputError(str(options.file), "no such file", "an .fmu file")
    findings = check_fmu(options.file)
    if options.map:
        from sidestep.fmu.importing.checks.driven_check import check_driven

        findings += [("driven", finding) for finding in check_driven(options.file, options.map)]
    for who, what in findings:
        print(f"{who:10}{what}")
    if not findings:
        print("nothing found")
    return 1 if findings else 0
