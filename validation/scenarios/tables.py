"""Tables of a TOML file checked against dataclasses, and overrides by dotted key; every error names its key."""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta

from sidestep.plant_models.documents import toml_value
from sidestep.plant_models.errors import InputError, did_you_mean
from sidestep.plant_models.ranges import Range, range_of

Name = Annotated[str, Meta(pattern=r"\A(?!\.{1,2}\Z)[\w.-]{1,100}\Z")]
"""What may become the name of a folder."""


def checked(
    cls: Any,
    table: Any,
    where: str = "",
    partial: bool = False,
    also: Mapping[str, Any] = MappingProxyType({}),
    without: Iterable[str] = (),
) -> dict[str, Any]:
    """The values of one table, each of the type that the dataclass `cls` gives its field.

    Args:
        cls: Dataclass whose fields are the keys; nested dataclasses are nested tables.
        table: What the file holds.
        where: Dotted key of the table, for the errors.
        partial: Keys without a default may be missing.
        also: Further keys and their types; they may be missing.
        without: Fields that are no keys of the file.

    Returns:
        Only the keys that the table has; nested tables as dictionaries.

    Raises:
        InputError: Unknown or missing key, or a value of another type, too large, or out of its bounds.
    """
    if not isinstance(table, dict):
        raise InputError(where, f"{table!r} is not a table")
    own = [f for f in fields(cls) if f.name not in set(without)]
    types = get_type_hints(cls, include_extras=True)
    hints = {**also, **{f.name: types[f.name] for f in own}}
    for key in table:
        if key not in hints:
            raise InputError(joined(where, key), f"unknown key{did_you_mean(key, hints)}", ", ".join(hints))
    for f in own:
        if f.name not in table and not partial and f.default is MISSING and f.default_factory is MISSING:
            raise InputError(joined(where, f.name), "missing")
    return {key: _value(hints[key], value, joined(where, key), partial) for key, value in table.items()}


def built(cls: Any, table: Any, where: str) -> Any:
    """The dataclass `cls` of one table; what it refuses itself is named by the file's key.

    Raises:
        InputError: As `checked`, or the dataclass refuses a value.
    """
    values = checked(cls, table, where)
    try:
        return cls(**values)
    except InputError as error:
        raise InputError(joined(where, error.where.rpartition(".")[2]), error.problem, error.allowed) from error


def file_at(folder: Path, name: str, where: str) -> Path:
    """The file that the key `where` names, seen from a folder.

    Raises:
        InputError: There is none.
    """
    if not (file := folder / name).is_file():
        raise InputError(where, f"no file {str(file.absolute())!r}", "the path of a file")
    return file


def joined(where: str, key: str) -> str:
    """The dotted key one level down."""
    return f"{where}.{key}" if where else key


def _value(hint: Any, value: Any, where: str, partial: bool) -> Any:
    nested = next((kind for kind in (hint, *get_args(hint)) if is_dataclass(kind)), None)
    if nested:
        return checked(nested, value, where, partial)
    try:
        result = msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        allowed = _in_words(hint, str(error)) + (f", {limits}" if (limits := range_of(hint)) else "")
        raise InputError(where, f"{value!r} cannot be used", allowed) from error
    limits = range_of(hint) or (_ANY if isinstance(result, float) else None)
    if limits and result is not None:
        limits.check(result, where, isinstance(result, int))
    return result


def _in_words(hint: Any, message: str) -> str:
    """What msgspec expected, in TOML's words, which have no null."""
    if hint is Name:
        return "1 to 100 letters, digits, _, . or -, but not . or .."
    if get_origin(hint) is Literal:
        return ", ".join(map(str, get_args(hint)))
    expected = re.sub(
        r"Expected `([^`]*)`", lambda kind: _WORDS.get(text := kind[1].removesuffix(" | null"), text), message
    )
    return expected.partition(", got")[0]


_ANY = Range(-1e9, 1e9)
"""Of a number whose unit only another key tells; what is larger overflows on its way through a run."""
_WORDS = {"float": "a number", "str": "text", "int": "a whole number", "object": "a table", "array": "a list"}


def override(tables: dict[str, Any], text: str) -> None:
    """Set one value in nested tables.

    Args:
        tables: Changed in place; missing tables are made.
        text: `key=value`: a dotted key (entries of lists by number) and a TOML value, or a bare string.

    Raises:
        InputError: Not of that form, or the key leads through a value or an entry that is not there.
    """
    key, separator, value = text.partition("=")
    parts = [part for part in re.split(r"[.\[\]]+", key.strip()) if part]
    if not separator or not parts:
        raise InputError("--set", f"{text!r} is not key=value", "a dotted key of the scenario file = a TOML value")
    target: Any = tables
    for part in parts[:-1]:
        target = _entry(target, part, key)
        if not isinstance(target, dict | list):
            raise InputError(f"--set {key}", f"{part!r} holds a value, not a table")
    if isinstance(target, list):
        target[_index(target, parts[-1], key)] = toml_value(value, f"--set {key}")
    else:
        target[parts[-1]] = toml_value(value, f"--set {key}")


def overrides_of(values: Mapping[str, Any], above: str = "") -> list[str]:
    """Values as `key=value`, what a table holds by its own keys.

    Args:
        values: By dotted keys; numbers, words, paths, lists, and tables of such.
        above: Key of the table that holds them.

    Raises:
        InputError: A value that no scenario file could hold.
    """
    found: list[str] = []
    for name, value in values.items():
        key = f"{above}.{name}".lstrip(".")
        if isinstance(value, Mapping):
            found += overrides_of(value, key)
        else:
            found.append(f"{key}={toml_text(value, key)}")
    return found


def toml_text(value: Any, key: str = "value") -> str:
    """A value as a TOML file has it.

    Args:
        value: A number, word, path, list, array, or a table with plain keys.
        key: For the error.

    Raises:
        InputError: Something else.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {toml_text(below, key)}" for name, below in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_text(one, key) for one in value) + "]"
    if isinstance(value, str | Path):
        return json.dumps(str(value), ensure_ascii=True).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    raise InputError(key, f"{value!r} is nothing that a scenario file holds", "a number, a word, a list or a table")


def _entry(target: Any, part: str, key: str) -> Any:
    return target[_index(target, part, key)] if isinstance(target, list) else target.setdefault(part, {})


def _index(target: list[Any], part: str, key: str) -> int:
    if not part.isdecimal() or len(part) > 9 or int(part) >= len(target):
        raise InputError(f"--set {key}", f"no entry {part[:60]!r} in a list of {len(target)}", "numbers from 0")
    return int(part)
