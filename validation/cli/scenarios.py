"""`sidestep scenarios` and `sidestep import`: scenario files that there are, their schema, and those of others."""

import argparse
import json
from pathlib import Path


def add_scenarios(commands: argparse._SubParsersAction) -> None:
    """Add the subcommand `scenarios`."""
    scenarios = commands.add_parser("scenarios", help="list the built-in scenarios")
    scenarios.add_argument("--schema", action="store_true", help="print the JSON schema of scenario files, for editors")
    scenarios.set_defaults(command=_scenarios)


def add_import(commands: argparse._SubParsersAction) -> None:
    """Add the subcommand `import`."""
    importing = commands.add_parser(
        "import", help="a CommonRoad or OpenSCENARIO file as a scenario file, and a picture"
    )
    importing.add_argument("file", type=Path, metavar="FILE", help="CommonRoad .xml or OpenSCENARIO .xosc")
    importing.add_argument("--out", type=Path, required=True, metavar="SCENE.toml", help="the picture stands beside it")
    importing.set_defaults(command=_import)


def _scenarios(options: argparse.Namespace) -> int:
    from sidestep.validation.scenarios.library import built_in_scenarios, outline

    if options.schema:
        from sidestep.validation.scenarios.schema import schema

        print(json.dumps(schema(), indent=2))
        return 0
    for name in built_in_scenarios():
        one = outline(name)
        print(f"{name:18}{one.speed:5.1f} m/s  {one.length:4.0f} m  {one.description}")
    return 0


def _import(options: argparse.Namespace) -> int:
    from sidestep.validation.files import check_file, companion, complete_path, write_text, written_file
    from sidestep.validation.report.topview import scene_view
    from sidestep.validation.scenarios.readers.formats import read_foreign, to_toml
    from sidestep.validation.scenarios.scenario import scenario_from_tables

    picture = companion(options.out, ".png")
    check_file(options.out, "--out")
    imported = read_foreign(options.file)
    scenario = scenario_from_tables(imported.tables, str(options.file), options.file, imported.notes)
    with written_file(options.out, "--out"):
        write_text(options.out, to_toml(imported.tables, imported.notes))
        with complete_path(picture) as file:
            scene_view(scenario).savefig(file, format="png", dpi=110)
    for note in scenario.notes:
        print(f"note: {note}")
    print(f"{options.out}: {scenario.path.length:.0f} m of road, {len(scenario.obstacles)} obstacles; {picture}")
    return 0
