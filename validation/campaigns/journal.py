"""An append-only file of JSON lines that outlives a killed process: a head, then a line for every row that is done."""

import errno
import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sidestep.plant_models.documents import json_value
from sidestep.plant_models.errors import InputError
from sidestep.validation.files import written_file

Row = dict[str, Any]


class Journal:
    """The rows that are done, and the way to add one; see `open_journal`.

    Attributes:
        rows: In the order in which they were done.
    """

    def __init__(self, file: Path, descriptor: int, rows: list[Row]):
        self._file, self._descriptor, self.rows = file, descriptor, rows

    def append(self, row: Row) -> None:
        """Add a row: one write, on the disk before this returns.

        Raises:
            InputError: The disk is full.
        """
        with written_file(self._file, "--out"):
            _write(self._descriptor, row)
        self.rows.append(row)


@contextmanager
def open_journal(file: Path, head: Mapping[str, Any]) -> Iterator[Journal]:
    """Begin a journal, or go on with one of the same head; a last line that was cut short is dropped.

    Args:
        file: Made if it is not there.
        head: First line; what it says of "about" may differ.

    Raises:
        InputError: The file cannot be written, belongs to something else, or is being written by another process.
    """
    try:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise InputError(str(file), f"cannot be written ({error.strerror})", "a writable file") from error
    try:
        _lock(descriptor, file)
        os.ftruncate(descriptor, file.read_bytes().rfind(b"\n") + 1)
        lines = _lines(file)
        if not lines:
            with written_file(file, "--out"):
                _write(descriptor, dict(head))
        elif _essential(lines[0]) != _essential(json.loads(json.dumps(head))):
            raise InputError(
                str(file), "holds the rows of another specification", "another folder, or none of its kind"
            )
        yield Journal(file, descriptor, lines[1:])
    finally:
        os.close(descriptor)


def read_journal(file: Path) -> tuple[Row, list[Row]]:
    """Head and rows of a journal, a last line that was cut short left out.

    Raises:
        InputError: No such file, or no journal.
    """
    try:
        lines = _lines(file)
    except OSError as error:
        raise InputError(str(file), f"cannot be read ({error.strerror})", "a campaign's .jsonl file") from error
    if not lines:
        raise InputError(str(file), "is empty", "a campaign's .jsonl file")
    return lines[0], lines[1:]


def _lines(file: Path) -> list[Row]:
    whole, _, _ = file.read_bytes().rpartition(b"\n")
    lines = [
        json_value(line, f"{file}: line {number}", "a campaign's .jsonl file")
        for number, line in enumerate(whole.split(b"\n") if whole else (), 1)
    ]
    if not all(isinstance(line, dict) for line in lines):
        raise InputError(str(file), "holds lines that are no objects", "a campaign's .jsonl file")
    return lines


def _essential(head: Mapping[str, Any]) -> Row:
    return {key: value for key, value in head.items() if key != "about"}


def _write(descriptor: int, row: Row) -> None:
    line = json.dumps(row, allow_nan=False).encode() + b"\n"
    if os.write(descriptor, line) < len(line):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    os.fsync(descriptor)


def _lock(descriptor: int, file: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        problem = f"is being written by another process{_owner(descriptor)}"
        raise InputError(str(file), problem, "one campaign at a time") from error


def _owner(descriptor: int) -> str:
    """Number and name of the process that holds the lock of a file, as Linux tells it; empty elsewhere."""
    status = os.fstat(descriptor)
    place = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    with suppress(OSError, ValueError):
        for line in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            if "FLOCK" in (words := line.split()) and place in words:
                number = int(words[words.index(place) - 1])
                return f", {number} ({Path(f'/proc/{number}/comm').read_text(errors='replace').strip()})"
    return ""
