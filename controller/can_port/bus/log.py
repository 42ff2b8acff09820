"""Files of CAN frames: .blf, .asc, .log (candump) and .csv, by ending."""

import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import can
from can.io.blf import BLFParseError

from sidestep.plant_models.errors import InputError

_WRITERS: dict[str, Any] = {
    ".blf": partial(can.BLFWriter, max_container_size=1 << 12),  # packing the usual 128 KiB takes half a cycle
    ".asc": can.ASCWriter, ".log": can.CanutilsLogWriter, ".csv": can.CSVWriter,
}  # fmt: skip
_READERS: dict[str, Any] = {
    ".blf": can.BLFReader, ".asc": can.ASCReader, ".log": can.CanutilsLogReader, ".csv": can.CSVReader,
}  # fmt: skip


def open_log(path: Path, overwrite: bool = True) -> Any:
    """A writer for what `can.Message`s arrive; a context manager.

    Args:
        path: File, whose ending says which kind.
        overwrite: Whether it may be there already.

    Raises:
        InputError: Unknown ending, or the file cannot be written, or is there already.
    """
    writer = _by_ending(_WRITERS, path)
    if not overwrite and path.exists():
        raise InputError(str(path), "is there already", "another name, or --overwrite")
    try:
        log = writer(path)
    except OSError as error:
        raise InputError(str(path), f"cannot write the CAN log: {error.strerror}") from error
    if isinstance(log, can.BLFWriter):
        log.start_timestamp = 0.0  # else the time of the first frame is taken for zero
    return log


def read_log(path: Path) -> Iterator[can.Message]:
    """The data frames of a log, oldest first.

    Raises:
        InputError: Unknown ending, or the file cannot be read.
    """
    reader = _by_ending(_READERS, path)
    try:
        how: dict[str, Any] = {"mode": "rb"} if reader is can.BLFReader else {"encoding": "utf-8", "newline": ""}
        with open(path, **how) as file:  # not by the reader, which leaves it open when it fails
            for message in reader(file):
                if not (message.is_error_frame or message.is_remote_frame):
                    yield message
    except (OSError, ValueError, IndexError, KeyError, struct.error, BLFParseError) as error:
        raise InputError(str(path), f"cannot read the CAN log: {error}") from error


def _by_ending(table: dict[str, Any], path: Path) -> Any:
    if path.suffix.lower() not in table:
        raise InputError(str(path), f"unknown kind of CAN log {path.suffix!r}", ", ".join(table))
    return table[path.suffix.lower()]
