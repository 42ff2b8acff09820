"""Databases of others, in any format that cantools reads, as they are: lenient where only strictness refuses them."""

from pathlib import Path

import cantools.database
from cantools.database.can import Database, Message, Signal

from sidestep.plant_models.errors import InputError

FORMATS = {".dbc": "dbc", ".kcd": "kcd", ".sym": "sym", ".arxml": "arxml"}
"""Formats by ending."""

_ENCODINGS = ("utf-8-sig", "cp1252")


def load_database(path: Path) -> tuple[Database, str]:
    """Read a database; what was not strictly right with it, or nothing.

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
        strictly = error
    try:
        return _parsed(text, kind, strict=False), " ".join(str(strictly).split())
    except Exception as error:  # cantools raises its own, its parser's and the standard library's errors
        raise InputError(str(path), f"cannot be read: {' '.join(str(error).split())}", f"a {kind} file") from error


def _parsed(text: str, kind: str, strict: bool) -> Database:
    database = cantools.database.load_string(text, database_format=kind, strict=strict, sort_signals=None)
    if not isinstance(database, Database):
        raise ValueError("describes no CAN bus")
    return database


def _text(path: Path) -> str:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from error
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


def signal_named(message: Message, name: str, where: str) -> Signal:
    """A signal by its name.

    Raises:
        InputError: There is none.
    """
    for signal in message.signals:
        if signal.name == name:
            return signal
    raise InputError(where, f"no signal {name!r} in {message.name}", ", ".join(s.name for s in message.signals))
