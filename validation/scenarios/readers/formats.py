"""Foreign scenario files by their ending, and scenario files written from what they hold."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.commonroad.reader import read_commonroad
from sidestep.validation.scenarios.readers.imported import Imported
from sidestep.validation.scenarios.readers.openscenario.reader import read_openscenario
from sidestep.validation.scenarios.readers.safe_xml import read_xml
from sidestep.validation.scenarios.tables import toml_text

ENDINGS = (".xml", ".xosc")
"""Of files that `read_foreign` takes."""


def read_foreign(file: Path, parameters: Mapping[str, str] | None = None) -> Imported:
    """The scenario of a CommonRoad (.xml) or OpenSCENARIO (.xosc) file.

    Args:
        file: To read.
        parameters: Values of an OpenSCENARIO file's parameters, instead of its own.

    Raises:
        InputError: Neither, or it asks for what would change the outcome and cannot be done.
    """
    root = read_xml(file)
    if root.tag == "commonRoad":
        if parameters:
            raise InputError("parameters", "a CommonRoad file has none")
        return read_commonroad(root, file)
    if root.tag == "OpenSCENARIO":
        return read_openscenario(root, file, parameters)
    raise InputError(str(file), f"its root element is {root.tag!r}", "commonRoad, OpenSCENARIO")


def to_toml(tables: dict[str, Any], notes: list[str]) -> str:
    """The text of a scenario file."""
    lines = [f"# {' '.join(note.split())}" for note in notes]
    later = []
    for key, value in tables.items():
        if isinstance(value, dict):
            later += ["", f"[{key}]", *(f"{name} = {toml_text(inner)}" for name, inner in value.items())]
        elif isinstance(value, list) and value and all(isinstance(row, dict) for row in value):
            for row in value:
                later += ["", f"[[{key}]]", *(f"{name} = {toml_text(inner)}" for name, inner in row.items())]
        else:
            lines.append(f"{key} = {toml_text(value)}")
    return "\n".join([*lines, *later]) + "\n"
