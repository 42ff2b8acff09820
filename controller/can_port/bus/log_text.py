"""Logs of text whose every line is a frame: candump's two formats, python-can's and SavvyCAN's .csv."""

import base64
import csv
import re
from collections.abc import Iterator
from typing import TextIO

import can

_FULL = re.compile(
    r"\((\d+\.\d+)\)\s+(\S+)\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(#[0-9A-Fa-f]|R)?([0-9A-Fa-f._]*)(?:\s+[RT])?"
)
_PLAIN = re.compile(
    r"(?:\((\d+[.\d-]*[ \d:.]*)\)\s+)?(\S+)(?:\s+[RT]X\s.*?)?\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+\[(\d+)\]\s*"
    r"(remote request|(?:[0-9A-Fa-f]{2}(?:\s|$))*).*"
)
_ERROR = 0x20000000


class BadLineError(ValueError):
    """A line that is no frame."""


def candump(file: TextIO) -> Iterator[can.Message]:
    """Frames of candump, with -L or without.

    Raises:
        BadLineError: What is neither.
    """
    for line in file:
        text = line.strip()
        if not text:
            continue
        if found := _FULL.fullmatch(text):
            yield _full(found)
        elif found := _PLAIN.fullmatch(text):
            yield _plain(found)
        else:
            raise BadLineError(f"{text[:40]!r} is no line of candump")


def _full(found: re.Match[str]) -> can.Message:
    time, channel, identifier, kind, content = found.groups()
    more: dict = {"timestamp": float(time), "channel": channel}
    if kind == "R":
        length = content[:1]
        return _message(identifier, **more, is_remote_frame=True, dlc=int(length, 16) if length else 0)
    if kind:
        flags = int(kind[1], 16)
        data = _hex(content)
        return _message(
            identifier, **more, is_fd=True, data=data, dlc=len(data), bitrate_switch=bool(flags & 1),
            error_state_indicator=bool(flags & 2),
        )  # fmt: skip
    data = _hex(content.partition("_")[0])
    return _message(identifier, **more, data=data, dlc=len(data))


def _plain(found: re.Match[str]) -> can.Message:
    time, channel, identifier, length, content = found.groups()
    try:
        stamp = float(time or 0.0)
    except ValueError:
        raise BadLineError(f"the time {time!r} is not counted in seconds (candump -ta, -tz or -L)") from None
    size = int(length)
    if content.startswith("remote"):
        return _message(identifier, timestamp=stamp, channel=channel, is_remote_frame=True, dlc=size)
    data = _hex(content)[:size]
    if len(data) != size:
        raise BadLineError(f"{len(data)} of {size} bytes")
    return _message(identifier, timestamp=stamp, channel=channel, data=data, dlc=size, is_fd=size > 8)


def _hex(text: str) -> bytes:
    digits = re.sub(r"[\s.]", "", text)
    if len(digits) % 2:
        raise BadLineError("half a byte")
    return bytes.fromhex(digits)


def _message(identifier: str, **more: object) -> can.Message:
    number, long = int(identifier, 16), len(identifier) == 8
    if long and number & _ERROR:
        return can.Message(
            arbitration_id=number & 0x1FFFFFFF, is_extended_id=False, is_error_frame=True,
            **more,  # pyright: ignore[reportArgumentType]
        )  # fmt: skip
    return can.Message(
        arbitration_id=number, is_extended_id=long,
        **more,  # pyright: ignore[reportArgumentType]
    )  # fmt: skip


def table(file: TextIO) -> Iterator[can.Message]:
    """Frames of a .csv that python-can or SavvyCAN wrote.

    Raises:
        BadLineError: Its head is neither's, or a line is no frame.
    """
    rows = csv.DictReader(file, skipinitialspace=True)
    heads = [head.strip().lower() for head in rows.fieldnames or ()]
    rows.fieldnames = heads
    if {"timestamp", "arbitration_id", "data"} <= set(heads):
        reader = _of_python_can
    elif {"time stamp", "id", "len"} <= set(heads):
        reader = _of_savvycan
    else:
        raise BadLineError(f"the head {', '.join(heads)[:60]!r} is not python-can's or SavvyCAN's")
    for row in rows:
        try:
            yield reader(row)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise BadLineError(f"no frame: {error}") from error


def _of_python_can(row: dict[str, str]) -> can.Message:
    data = base64.b64decode(row["data"], validate=True)
    remote = row["remote"] == "1"
    return can.Message(
        timestamp=float(row["timestamp"]), arbitration_id=int(row["arbitration_id"], 16),
        is_extended_id=row["extended"] == "1", is_remote_frame=remote, is_error_frame=row["error"] == "1",
        dlc=int(row["dlc"]), data=None if remote else data, is_fd=int(row["dlc"]) > 8, channel=0,
    )  # fmt: skip


def _of_savvycan(row: dict[str, str]) -> can.Message:
    size = int(row["len"])
    data = bytes(int(row[f"d{k + 1}"], 16) for k in range(size))
    return can.Message(
        timestamp=1e-6 * int(row["time stamp"]), arbitration_id=int(row["id"], 16),
        is_extended_id=row["extended"].lower() in ("true", "1"), dlc=size, data=data, is_fd=size > 8,
        channel=int(row.get("bus") or 0), is_rx=not (row.get("dir") or "Rx").lower().startswith("t"),
    )  # fmt: skip
