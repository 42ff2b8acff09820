"""Every table and key of a scenario file, taken from the types that read it: a JSON schema and a page of the docs."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from sidestep.controller import ControllerConfig
from sidestep.plant_models.mujoco.surface import FrictionPatch
from sidestep.plant_models.ranges import Range, range_of
from sidestep.plant_models.road.segments import Arc, Clothoid, Line
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.vehicle.parameters import SuspensionParameters, VehicleParameters
from sidestep.validation.scenarios.goal import Goal
from sidestep.validation.scenarios.plant_settings import HeightTable, PlantSettings
from sidestep.validation.scenarios.road_table import RoadTable
from sidestep.validation.scenarios.scenario import ScenarioTables, StartTable
from sidestep.validation.scenarios.traffic import ObstacleTable, TrajectoryTable

_PARTIAL = "that of the preset"
_OF_FILE = "the file's"
_TYRE = "Coefficient of the tyre law, named as in a property file."


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes:
        name: As in the file.
        hint: Its type.
        default: What holds if it is not given, as TOML; "required" if it must be.
        text: What it means.
    """

    name: str
    hint: Any
    default: str
    text: str

    @property
    def range(self) -> Range | None:
        """The numbers that it takes."""
        return range_of(self.hint)


@dataclass(frozen=True)
class Table:
    """One table of a scenario file.

    Attributes:
        name: Dotted; lists of tables end with [].
        cls: The type that reads it.
        text: What it holds.
        keys: In order.
        example: TOML, of the whole table.
    """

    name: str
    cls: type
    text: str
    keys: tuple[Key, ...]
    example: str


def tables() -> tuple[Table, ...]:
    """All tables of a scenario file."""
    preset = Key("preset", str, '"default"', "Name of the configuration that the others are put into: default, paper.")
    kind = Key("kind", str, '""', "`module:factory` of a controller of your own, with ours beside it; empty for ours.")
    car = (
        Key("preset", str, '"bmw-320i"', "Name of the car that the others are put into, see `sidestep vehicles`."),
        Key("file", str, '""', "TOML file with such values instead of a preset."),
        Key("tyre_file", str, '""', "Tyre property file (.tir) for its tyres."),
    )
    elsewhere = ("width_left", "width_right", "cruise_speed", "name")
    return (
        _table("", ScenarioTables, _EXAMPLES[""]),
        _table("road", RoadTable, _EXAMPLES["road"]),
        _table('road.segments[], type = "line"', Line, '{ type = "line", length = 150.0 }'),
        _table('road.segments[], type = "arc"', Arc, '{ type = "arc", length = 60.0, curvature = 0.01 }'),
        _table(
            'road.segments[], type = "clothoid"', Clothoid,
            '{ type = "clothoid", length = 30.0, curvature_start = 0.0, curvature_end = 0.01 }',
        ),
        _table("start", StartTable, _EXAMPLES["start"]),
        _table("goal", Goal, _EXAMPLES["goal"]),
        _table("obstacles[]", ObstacleTable, _EXAMPLES["obstacles[]"]),
        _table("obstacles[].trajectory", TrajectoryTable, _EXAMPLES["obstacles[].trajectory"]),
        _table("vehicle", VehicleParameters, _EXAMPLES["vehicle"], car, elsewhere, partial=True),
        _table("vehicle.tyre", TyreParameters, "[vehicle.tyre]\np_dy1 = 0.9", partial=True),
        _table("vehicle.suspension", SuspensionParameters, "[vehicle.suspension]\nspring_front = 3e4", partial=True),
        _table("controller", ControllerConfig, _EXAMPLES["controller"], (preset, kind), elsewhere, partial=True),
        _table("plant", PlantSettings, _EXAMPLES["plant"]),
        _table("plant.patches[]", FrictionPatch, "{ s = 30.0, length = 10.0, l = 0.0, width = 4.0, friction = 0.2 }"),
        _table("plant.heights", HeightTable, '{ path = "bumps.csv", spacing = 0.1 }'),
    )  # fmt: skip


_EXAMPLES = {
    "": 'name = "my-scene"\nspeed = 15.0\nduration = 8.0',
    "road": '[road]\nwidth_left = 4.0\nwidth_right = 4.0\nsegments = [{ type = "line", length = 150.0 }]',
    "start": "[start]\ns = 0.0\nl = -0.5\nspeed = 12.0",
    "goal": "[goal]\ns = [100.0, 150.0]\nspeed = [0.0, 20.0]",
    "obstacles[]": "[[obstacles]]\ns = 40.0\nl = 0.5\nlength = 4.5\nwidth = 1.8\nspeed = 3.0",
    "obstacles[].trajectory": (
        '[[obstacles]]\nlength = 0.5\nwidth = 0.5\ntrajectory = { frame = "road", t = [0.0, 4.0], s = [60.0, 60.0], '
        "l = [-3.0, 3.0] }"
    ),
    "vehicle": '[vehicle]\npreset = "bmw-320i"\nmass = 1200.0',
    "controller": "[controller]\nbuffer = 0.3",
    "plant": '[plant]\nkind = "linear"\nfriction = 0.8',
}


def _table(
    name: str, cls: Any, example: str, also: Iterable[Key] = (), without: Iterable[str] = (), partial: bool = False
) -> Table:
    summary, texts = documented(cls)
    hints, keys = get_type_hints(cls, include_extras=True), list(also)
    for f in fields(cls):
        if f.name in without:
            continue
        default = f.default
        if f.default_factory is not MISSING:
            default = f.default_factory()
        if cls is ScenarioTables and f.name == "name":
            default = _OF_FILE
        given = _PARTIAL if partial else "required" if default is MISSING else _toml(default)
        keys.append(
            Key(f.name, hints[f.name], given, texts.get(f.name, _TYRE) if cls is TyreParameters else texts[f.name])
        )
    return Table(name, cls, summary, tuple(keys), example)


def documented(cls: Any) -> tuple[str, Mapping[str, str]]:
    """Summary of a dataclass and the text on each field, from its docstring.

    Raises:
        KeyError: A field has no text; a test sees to that.
    """
    text = re.sub(r"\s*\n\s*", "\n", cls.__doc__ or "")
    summary, _, attributes = text.partition("\nAttributes:\n")
    found: dict[str, str] = {}
    names: list[str] = []
    for line in attributes.split("\n"):
        match = re.match(r"^([a-z_0-9]+(?:, [a-z_0-9]+)*): (.*)$", line)
        if match and all(name in {f.name for f in fields(cls)} for name in match[1].split(", ")):
            names = match[1].split(", ")
            found |= dict.fromkeys(names, match[2])
        else:
            found |= {name: f"{found[name]} {line}".strip() for name in names}
    return " ".join(summary.split("\n\n")[0].split()), found


def schema() -> dict[str, Any]:
    """The JSON schema of scenario files, draft 2020-12."""
    by_name = {table.name: table for table in tables()}
    top = _object(by_name[""])
    properties = top["properties"]
    for name in ("road", "start", "goal", "vehicle", "controller", "plant"):
        properties[name] = _object(by_name[name])
    obstacle = _object(by_name["obstacles[]"])
    obstacle["properties"]["trajectory"] = _object(by_name["obstacles[].trajectory"])
    properties["obstacles"] = {"type": "array", "items": obstacle}
    kinds = [(kind, by_name[f'road.segments[], type = "{kind}"']) for kind in ("line", "arc", "clothoid")]
    properties["road"]["properties"]["segments"] = {"type": "array", "items": {"oneOf": [_segment(*k) for k in kinds]}}
    for name in ("tyre", "suspension"):
        properties["vehicle"]["properties"][name] = _object(by_name[f"vehicle.{name}"])
    properties["plant"]["properties"]["patches"] = {"type": "array", "items": _object(by_name["plant.patches[]"])}
    properties["plant"]["properties"]["heights"] = _object(by_name["plant.heights"])
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "sidestep scenario", **top}


def _segment(kind: str, table: Table) -> dict[str, Any]:
    result = _object(table)
    result["properties"] = {"type": {"const": kind}, **result["properties"]}
    result["required"] = ["type", *result.get("required", [])]
    return result


def _object(table: Table) -> dict[str, Any]:
    required = [key.name for key in table.keys if key.default == "required"]
    properties = {key.name: {**_type(key.hint), "description": key.text} for key in table.keys}
    result = {"type": "object", "description": table.text, "properties": properties, "additionalProperties": False}
    return result | ({"required": required} if required else {})


def _type(hint: Any) -> dict[str, Any]:
    hint = _bare(hint)
    kinds = {float: "number", int: "integer", str: "string", bool: "boolean"}
    if get_origin(hint) is Literal:
        return {"enum": list(get_args(hint))}
    base = _base(hint)
    if base in kinds:
        limits = range_of(hint)
        return {"type": kinds[base], **({"minimum": limits.low, "maximum": limits.high} if limits else {})}
    if base in (list, tuple):
        inner = [arg for arg in get_args(hint) if arg is not Ellipsis]
        return {"type": "array", **({"items": _type(inner[0])} if inner and inner[0] is not Any else {})}
    return {"type": "object"} if base is dict else {}


def _bare(hint: Any) -> Any:
    """Without "or None": TOML has none."""
    arguments = [argument for argument in get_args(hint) if argument is not NoneType]
    return arguments[0] if len(arguments) < len(get_args(hint)) and len(arguments) == 1 else hint


def _base(hint: Any) -> Any:
    hint = get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
    return get_origin(hint) or hint


def _toml(value: Any) -> str:
    if value is None:
        return "not given"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value if value == _OF_FILE else f'"{value}"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(inner) for inner in value) + "]"
    return "{}" if isinstance(value, dict) else f"{value:g}" if isinstance(value, float) else str(value)


_WORDS = {
    "number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "array": "list",
    "object": "table",
}  # fmt: skip


def markdown() -> str:
    """The page docs/scenarios.md."""
    parts = [_HEAD]
    for table in tables():
        parts.append(f"## `{table.name}`\n" if table.name else "## Top of the file\n")
        parts.append(f"{table.text}\n\n```toml\n{table.example}\n```\n")
        parts.append("| key | type | default | allowed | |\n|---|---|---|---|---|")
        for key in table.keys:
            kind = _type(key.hint)
            word = "one of" if "enum" in kind else _WORDS.get(kind.get("type", ""), "any")
            allowed = ", ".join(kind["enum"]) if "enum" in kind else str(key.range or "")
            parts.append(f"| `{key.name}` | {word} | {key.default} | {allowed} | {key.text} |")
        parts.append("")
    return "\n".join(parts)


_HEAD = """# Scenario files

Made from the types that read them by `python tools/pages.py`; for editors there is `sidestep scenarios --schema` (JSON
schema). Files are TOML; lengths in m, times in s, angles in rad. An unknown key is an error. Files of others:
[foreign scenarios](foreign_scenarios.md).

Every key of every table is one of `--set`, too, by its dotted path; `[]` stands for every entry of a list, in `--set` a
number from 0: `--set obstacles.0.s=30`. A number outside of what is allowed ends the command in one line with key,
value and range and exit status 2. The ranges are generous: they keep out what cannot be a car, a road or a control
period, not what is unusual.

On a road of way-points `s` and `l` count along their polyline and beside its chords, headings are relative to the mean
direction at the way-points, interpolated between them. The path that is driven strays from that polyline by at most
0.1 m, or by what `road.smooth` allows; a file for which that is not possible is refused, with the place. What was
merged, taken as closed or smoothed is printed as a note and stands in summary.json.
"""
