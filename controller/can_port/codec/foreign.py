"""Databases of others, in any format that cantools reads, as they are: lenient where only strictness refuses them."""

import re
from pathlib import Path

import cantools.database
from cantools.database.can import Database, Message, Signal

from sidestep.controller.can_port.codec.database import EXTENDED
from sidestep.plant_models.documents import file_bytes
from sidestep.plant_models.errors import InputError

FORMATS = {".dbc": "dbc", ".kcd": "kcd", ".sym": "sym", ".arxml": "arxml"}
"""Formats by ending."""

_ENCODINGS = ("utf-8-sig", "cp1252")
_MOST_BYTES, _MOST_LEFT_OUT = 16_000_000, 50  # the largest public ones hold 2 MB; every line left out is a reading more


def load_database(path: Path) -> tuple[Database, str]:
    """Read a database; what was not strictly right with it, and which lines were left out for that, or nothing.

    Raises:
        InputError: It cannot be read.
    """
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise InputError(str(path), f"unknown kind of database {path.suffix!r}", ", ".join(FORMATS))
    text = _text(path)
    try:
        return _parsed(text, kind, strict=True), ""
    except Exception as error:
        strictly = " ".join(str(error).split())
    text, left_out = _mended(text, kind), []
    for _ in range(_MOST_LEFT_OUT):
        try:
            return _parsed(text, kind, strict=False), "; ".join([strictly, *left_out])
        except Exception as error:  # cantools raises its own, its parser's and the standard library's errors
            why = " ".join(str(error).split())
            text, line = _without(text, why)
            if line is None:
                raise InputError(str(path), f"cannot be read: {why}", f"a {kind} file") from error
            left_out.append(f"left out: {line}")
    raise InputError(str(path), f"still cannot be read without {_MOST_LEFT_OUT} of its lines", f"a {kind} file")


_DROPPABLE = ("CM_", "VAL_", "BA_", "SIG_GROUP_")
_UNUSED = re.compile(r"unused VAL_ entries in DBC: (VAL_ \d+ \w+)")


def _without(text: str, why: str) -> tuple[str, str | None]:
    """The text without the line of comments, names or attributes that an error names; None if it names none."""
    lines = text.split("\n")
    numbered, unused = re.search(r"at line (\d+)", why), _UNUSED.search(why)
    for k, line in enumerate(lines):
        named = k + 1 == int(numbered[1]) if numbered else unused is not None and line.startswith(unused[1] + " ")
        if named and line.lstrip().startswith(_DROPPABLE):
            return "\n".join([*lines[:k], "", *lines[k + 1 :]]), line.strip()[:60]
    return text, None


def _parsed(text: str, kind: str, strict: bool) -> Database:
    database = cantools.database.load_string(text, database_format=kind, strict=strict)
    if not isinstance(database, Database):
        raise ValueError("describes no CAN bus")
    if not all(thing.name for message in database.messages for thing in (message, *message.signals)):
        raise ValueError("a message or a signal without a name")
    return database


_NUMBERED = re.compile(
    r"^(\s*SG_ |BO_ \d+ |(?:CM_|BA_ \"\w+\"|VAL_|SIG_VALTYPE_)(?: SG_)? \d+ )(\d\w*)(?=\s|:)", re.MULTILINE
)


_MESSAGE = re.compile(r"^BO_ (\d{1,10}) ", re.MULTILINE)
_REFERENCE = re.compile(r"\b([A-Z_]+_) (\d{1,10})\b")


def _mended(text: str, kind: str) -> str:
    """What no parser takes: names of signals that begin with a digit, long identifiers without the flag of such."""
    if kind != "dbc":
        return text
    text = _NUMBERED.sub(r"\1_\2", text)
    long = {number for found in _MESSAGE.findall(text) if 0x7FF < (number := int(found)) <= 0x1FFFFFFF}
    return _REFERENCE.sub(lambda at: f"{at[1]} {int(at[2]) | EXTENDED}" if int(at[2]) in long else at[0], text)


def _text(path: Path) -> str:
    data = file_bytes(path, "a database of messages")
    if len(data) > _MOST_BYTES:
        raise InputError(str(path), f"{len(data)} bytes", f"up to {_MOST_BYTES}")
    for encoding in _ENCODINGS:
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return data.decode("latin-1")


def message_named(database: Database, name: str, where: str) -> Message:
    """A message by its name, or identifier as in 0x12C.

    Args:
        database: In which.
        name: Its name.
        where: Place in the mapping file, for the error.

    Raises:
        InputError: There is none.
    """
    for message in database.messages:
        if name == message.name or name.lower() == f"0x{message.frame_id:x}":
            return message
    raise InputError(
        where, f"no message {name!r} in the database", ", ".join(sorted(m.name for m in database.messages))
    )


_PLACE = re.compile(r"(\d+)\|(\d+)@([01])([+-])?")


def signal_named(message: Message, name: str, where: str) -> Signal:
    """A signal by its name, or by its place as a .dbc has it, such as 8|4@1+, where the database leaves it out.

    Raises:
        InputError: There is none, or it does not fit into the message.
    """
    if place := _PLACE.fullmatch(name):
        start, length = int(place[1]), int(place[2])
        if length == 0 or start >= 8 * message.length or length > 8 * message.length:
            raise InputError(where, f"{name} is outside {message.name}", f"bits 0 to {8 * message.length - 1}")
        order = "little_endian" if place[3] == "1" else "big_endian"
        return Signal(name, start, length, order, is_signed=place[4] == "-")
    for signal in message.signals:
        if signal.name == name:
            return signal
    raise InputError(where, f"no signal {name!r} in {message.name}", ", ".join(s.name for s in message.signals))
