"""TOML and JSON from outside: the one reader of each, which lets nothing out but values that can be used.

What a parser accepts and nothing behind it can take is refused here, with its key: dates, whole numbers of more than
64 bits, text that is no Unicode, and tables in tables without end.
"""

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError

MAX_BYTES, MAX_DEPTH = 64_000_000, 64
"""Of a file, and of tables and lists in each other."""

_LARGEST = 2**63 - 1  # TOML's whole numbers


def file_bytes(path: str | Path, allowed: str = "") -> bytes:
    """What a file or a pipe holds.

    Raises:
        InputError: It cannot be read, or holds more than MAX_BYTES.
    """
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # a name with a zero byte is a ValueError
        raise InputError(str(path), f"cannot be read ({_reason(error)})", allowed) from error
    if len(data) > MAX_BYTES:
        raise InputError(str(path), f"more than {MAX_BYTES} bytes", f"up to {MAX_BYTES} bytes")
    return data


def file_text(path: str | Path, allowed: str = "") -> str:
    """The text of a file in UTF-8, each line's end a line feed.

    Raises:
        InputError: It cannot be read, is too long, or is no UTF-8.
    """
    try:
        return file_bytes(path, allowed).decode().replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise InputError(str(path), f"cannot be read ({error})", allowed or "UTF-8") from error


def read_toml(path: str | Path, allowed: str = "") -> dict[str, Any]:
    """The tables of a TOML file.

    Args:
        path: The file.
        allowed: What the errors say that would be accepted.

    Raises:
        InputError: It cannot be read, is no TOML, or holds what nothing here can take.
    """
    return toml_tables(file_text(path, allowed), str(path), allowed)


def toml_tables(text: str, label: str, allowed: str = "") -> dict[str, Any]:
    """The tables of TOML text, which errors call `label`.

    Raises:
        InputError: As `read_toml`.
    """
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of a number with thousands of digits
        raise InputError(label, f"no readable TOML file ({_reason(error)})", allowed) from error
    _require_plain(tables, label)
    return tables


def toml_value(text: str, label: str) -> Any:
    """A TOML value; what is none is text.

    Raises:
        InputError: It is one, and nothing here can take it.
    """
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    except (ValueError, RecursionError) as error:
        raise InputError(label, f"no value ({_reason(error)})") from error
    _require_plain(value, label)
    return value


def read_json(path: str | Path, allowed: str = "") -> Any:
    """The value of a JSON file.

    Raises:
        InputError: It cannot be read, is no JSON, or holds what nothing here can take.
    """
    return json_value(file_bytes(path, allowed), str(path), allowed)


def json_value(text: str | bytes, label: str, allowed: str = "") -> Any:
    """The value of JSON text, which errors call `label`.

    Raises:
        InputError: As `read_json`.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(label, f"is no JSON ({_reason(error)})", allowed) from error
    _require_plain(value, label)
    return value


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return f"nested more than {MAX_DEPTH} deep"
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def _require_plain(value: Any, label: str) -> None:
    left = [(value, "", 0)]
    while left:
        inner, key, depth = left.pop()
        place = f"{label}: {key}" if key else label
        if depth > MAX_DEPTH:
            raise InputError(place[:200], f"nested more than {MAX_DEPTH} deep")
        if isinstance(inner, dict | list):
            left += [(below, name, depth + 1) for name, below in _inside(inner, key)]
        elif problem := _problem(inner):
            raise InputError(place, problem)


def _inside(value: dict[str, Any] | list[Any], key: str) -> Iterator[tuple[str, Any]]:
    """What is in a table or list, but plain numbers, with its dotted key; the keys of a table, too."""
    if isinstance(value, list):
        yield from ((f"{key}[{i}]", below) for i, below in enumerate(value) if type(below) is not float)
        return
    for name, below in value.items():
        yield key, name
        yield f"{key}.{name}" if key else name, below


def _digits(value: int) -> str:
    """A number that may have more digits than a line, or than Python prints."""
    text = str(value) if value.bit_length() < 4000 else hex(value)
    return text if len(text) <= 40 else f"{text[:20]}..."


def _problem(value: Any) -> str:
    if value is None or isinstance(value, bool | float):
        return ""
    if isinstance(value, int):
        return "" if -_LARGEST - 1 <= value <= _LARGEST else f"{_digits(value)}: a whole number of more than 64 bits"
    if not isinstance(value, str):
        return f"a {type(value).__name__}, {value}, where a number or text is needed"
    return "text that is no Unicode" if any("\ud800" <= letter <= "\udfff" for letter in value) else ""
