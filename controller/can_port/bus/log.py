"""Files of CAN frames, by ending: written as .blf, .asc, .log (candump) and .csv; read from more, packed or not."""

import gzip
import io
import logging
import sqlite3
import struct
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import can

from sidestep.controller.can_port.bus.log_blf import CarefulBlfReader
from sidestep.controller.can_port.bus.log_text import candump, table
from sidestep.controller.can_port.codec.samples import EXACT_ID, LOG_CHANNEL
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.unpacking import unpack_gz

_WRITERS: dict[str, Any] = {
    ".blf": partial(can.BLFWriter, max_container_size=1 << 12),  # packing the usual 128 KiB takes half a cycle
    ".asc": can.ASCWriter, ".log": can.CanutilsLogWriter, ".csv": can.CSVWriter,
}  # fmt: skip
_TEXT: dict[str, Callable[[Any], Iterator[can.Message]]] = {
    ".asc": lambda file: iter(can.ASCReader(file)), ".log": candump, ".csv": table,
    ".trc": lambda file: iter(can.TRCReader(file)), ".candump": candump,
}  # fmt: skip
_WHOLE: dict[str, Any] = {".db": can.SqliteReader, ".mf4": can.MF4Reader}
READABLE = (".blf", *_TEXT, *_WHOLE)
"""Kinds of logs that can be read, each also packed as .gz."""

LATEST = 1e11
"""Time stamps that a log may have, in [s]: later ones, and none before 0, are damage."""

_LONGEST_LINE = 1 << 20  # letters


@dataclass
class LogReport:
    """What a log held, told while it is read.

    Attributes:
        frames: Data frames by channel.
        others: Error and remote frames, and such.
        backwards: How often time went back.
        damage: What ended the reading before the end; empty for nothing.
    """

    frames: Counter[str] = field(default_factory=Counter)
    others: Counter[str] = field(default_factory=Counter)
    backwards: int = 0
    damage: str = ""
    _last: float = float("-inf")

    def take(self, message: can.Message) -> bool:
        """Count a frame; whether it is a data frame."""
        if message.is_error_frame or message.is_remote_frame:
            self.others["error frames" if message.is_error_frame else "remote frames"] += 1
            return False
        if message.arbitration_id != EXACT_ID or message.channel != LOG_CHANNEL:
            self.frames[str(message.channel)] += 1
        self.backwards += message.timestamp < self._last
        self._last = message.timestamp
        return True

    def sentences(self) -> list[str]:
        """What there is to say, nothing of a log without anything odd."""
        found = [self.damage] if self.damage else []
        if self.backwards:
            found.append(f"time goes back {self.backwards} times")
        if len(self.frames) > 1:
            each = ", ".join(f"{name}: {count}" for name, count in sorted(self.frames.items()))
            found.append(f"frames of several channels ({each}), all taken; --channel takes one")
        found += [f"{count} {name} left aside" for name, count in self.others.items()]
        return found


def open_log(path: Path, overwrite: bool = True) -> Any:
    """A writer for what `can.Message`s arrive; a context manager.

    Args:
        path: File, whose ending says which kind.
        overwrite: Whether it may be there already.

    Raises:
        InputError: Unknown ending, or the file cannot be written, or is there already.
    """
    if path.suffix.lower() not in _WRITERS:
        raise InputError(str(path), f"unknown kind of CAN log {path.suffix!r}", ", ".join(_WRITERS))
    if not overwrite and path.exists():
        raise InputError(str(path), "is there already", "another name, or --overwrite")
    try:
        log = _WRITERS[path.suffix.lower()](path)
    except OSError as error:
        raise InputError(str(path), f"cannot write the CAN log: {error.strerror}") from error
    if isinstance(log, can.BLFWriter):
        log.start_timestamp = 0.0  # else the time of the first frame is taken for zero
    return log


def read_log(path: Path, channel: str | None = None, report: LogReport | None = None) -> Iterator[can.Message]:
    """The data frames of a log in its order, one at a time.

    A damaged log is read up to the damage, which the report names.

    Args:
        path: File, whose ending says which kind.
        channel: The only one that counts; None for all.
        report: Is told what the log held.

    Raises:
        InputError: Unknown ending, or nothing can be read.
    """
    report, any_frame = report or LogReport(), False
    lines = _Lines()
    try:
        with _warnings_counted(report), _messages(path, lines) as messages:
            for message in messages:
                if channel is not None and str(message.channel) != channel:
                    continue
                any_frame = True
                if not 0.0 <= message.timestamp <= LATEST:
                    raise ValueError(f"a time stamp of {message.timestamp:g} s")
                if report.take(message):
                    yield message
    except (InputError, MemoryError):
        raise
    except Exception as error:  # python-can's readers let every kind of error out
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error) or type(error).__name__
        place = f"line {lines.number}: " if lines.number else ""
        if not any_frame:
            if isinstance(error, struct.error):
                why = f"its content is not that of its ending ({why})"
            raise InputError(str(path), f"cannot read the CAN log: {place}{why}", _allowed()) from error
        count = report.frames.total() + report.others.total()
        report.damage = f"damaged: {place}{why}; {count} frames read before"


@contextmanager
def _warnings_counted(report: LogReport) -> Iterator[None]:
    """Count what python-can's readers drop, which it would print otherwise."""
    logger, counter = logging.getLogger("can"), _Counter(logging.WARNING)
    counter.counts = report.others
    logger.addHandler(counter)
    before, logger.propagate = logger.propagate, False
    try:
        yield
    finally:
        logger.propagate = before
        logger.removeHandler(counter)


class _Counter(logging.Handler):
    counts: Counter[str]

    def emit(self, record: logging.LogRecord) -> None:
        self.counts["lines that are no frames"] += 1


def _allowed() -> str:
    return f"{', '.join(READABLE)}, each also as .gz"


@contextmanager
def _messages(path: Path, lines: "_Lines") -> Iterator[Iterator[can.Message]]:
    packed = path.suffix.lower() == ".gz"
    kind = (path.with_suffix("") if packed else path).suffix.lower()
    if kind not in READABLE:
        raise InputError(str(path), f"unknown kind of CAN log {kind!r}", _allowed())
    with ExitStack() as resources:
        if kind in _WHOLE:
            yield iter(_whole(kind, path, packed, resources))
            return
        file: BinaryIO = resources.enter_context(gzip.open(path) if packed else open(path, "rb"))  # type: ignore[arg-type] # noqa: SIM115
        if kind == ".blf":
            yield iter(CarefulBlfReader(file))
        else:
            lines.file = io.TextIOWrapper(file, encoding="utf-8-sig", errors="replace", newline="")
            yield _TEXT[kind](lines)


def _whole(kind: str, path: Path, packed: bool, resources: ExitStack) -> Any:
    """A reader of a kind that has to be a file, unpacked first if need be."""
    if packed:
        folder = resources.enter_context(tempfile.TemporaryDirectory())
        unpacked = Path(folder) / f"log{kind}"
        unpack_gz(path, unpacked)
        path = unpacked
    if kind == ".db":
        _require_table(path)
    with path.open("rb") as file:
        if kind == ".mf4" and file.read(3) != b"MDF":  # asammdf would leave it open
            raise ValueError("no MDF file")
    try:
        return resources.enter_context(_WHOLE[kind](path))
    except ImportError as error:
        raise InputError(str(path), "needs the extra mdf", "pip install 'sidestep[mdf]'") from error


def _require_table(path: Path) -> None:
    """Refuse a database that would work the frames out: a view may have no end."""
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        kinds = database.execute("SELECT type FROM sqlite_master WHERE name = 'messages'").fetchall()
    if kinds != [("table",)]:
        raise ValueError("no table of messages")


class _Lines:
    """Lines of a file, counted, in the way that python-can's readers take them.

    Attributes:
        file: Open for reading.
        number: Of the last line.
    """

    def __init__(self) -> None:
        self.file: Any = None
        self.number = 0

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        line = self.readline()
        if not line:
            raise StopIteration
        return line

    def readline(self) -> str:
        """The next line; empty at the end."""
        line = self._next()
        while "start of measurement" in line.lower():  # which some tools write in ways of their own
            self.number += 1
            line = self._next()
        self.number += bool(line)
        return line

    def _next(self) -> str:
        line = self.file.readline(_LONGEST_LINE)
        if len(line) == _LONGEST_LINE:
            raise ValueError(f"a line of {_LONGEST_LINE} letters or more")
        return line

    def close(self) -> None:
        """Leave the file to who opened it."""
