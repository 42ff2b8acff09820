"""The scenarios that come with the package, and the text of any: light to load, for lists and for wrong names."""

from pathlib import Path
from typing import NamedTuple

from sidestep.plant_models.documents import file_text, toml_tables
from sidestep.plant_models.errors import InputError, did_you_mean

_BUILT_IN = Path(__file__).parent / "built_in"


class Outline(NamedTuple):
    """A line of the list of scenarios.

    Attributes:
        name: As the command line takes it.
        speed: To hold, in [m/s].
        length: Of the road, in [m].
        description: A few words.
    """

    name: str
    speed: float
    length: float
    description: str


def built_in_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that come with the package."""
    return tuple(sorted(file.stem for file in _BUILT_IN.glob("*.toml")))


def outline(name: str) -> Outline:
    """What the list says of a built-in scenario."""
    _, text = read_scenario(name)
    tables = toml_tables(text, name)
    length = sum(segment["length"] for segment in tables["road"]["segments"])
    return Outline(name, tables["speed"], length, tables["description"])


def read_scenario(name_or_path: str | Path, folder: Path = Path()) -> tuple[Path, str]:
    """File and text of a scenario; a built-in one stands as if in `folder`, for the files that overrides name.

    Args:
        name_or_path: One of `built_in_scenarios()`, a TOML file, a CommonRoad .xml or an OpenSCENARIO .xosc file.
        folder: From which the file is found.

    Raises:
        InputError: There is none, or it cannot be read.
    """
    name, known = str(name_or_path), built_in_scenarios()
    if name in known:
        return folder / f"{name}.toml", (_BUILT_IN / f"{name}.toml").read_text(encoding="utf-8")
    file = folder / name
    if not file.is_file():
        problem = f"no built-in scenario and no file {name!r}{did_you_mean(name, known)}"
        raise InputError("scenario", problem, f"{', '.join(known)}, or a TOML, .xml or .xosc file")
    if file.suffix.lower() in (".xml", ".xosc"):
        from sidestep.validation.scenarios.readers.formats import read_foreign, to_toml

        imported = read_foreign(file)
        return file, to_toml(imported.tables, imported.notes)
    return file, file_text(file, "a TOML file")
