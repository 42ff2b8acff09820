"""`sidestep can monitor`: every message on the bus, decoded, with the state of its protection."""

import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.live import Live
from rich.table import Table

from sidestep.controller.can_port.bus.bus import Bus, key_of
from sidestep.controller.can_port.bus.candump import CandumpWriter
from sidestep.controller.can_port.bus.channel import Channel
from sidestep.controller.can_port.bus.log import open_log
from sidestep.controller.can_port.codec.catalogue import BusDescription, own_bus
from sidestep.controller.can_port.codec.database import EXTENDED, messages
from sidestep.controller.can_port.protection.e2e import CheckStatus
from sidestep.plant_models.errors import InputError

_REFRESH = 0.2  # time between two tables, in [s]
_GOOD = (CheckStatus.OK, CheckStatus.INITIAL)


class Observer:
    """What has been seen of every message.

    Args:
        bus: What travels on the bus.
    """

    def __init__(self, bus: BusDescription | None = None):
        described = bus or own_bus()
        self._channels = {message.frame_id: Channel(message) for message in described.messages.values()}
        self._messages = {
            message.frame_id | EXTENDED * message.is_extended_frame: message
            for database in reversed(described.databases)
            for message in database.messages
        }
        self._seen: dict[int, tuple[int, float, float, bytes]] = {}  # count, first and last time, data

    def add(self, frame_id: int, data: bytes, now: float) -> None:
        """Take in a frame that arrived at `now`, in [s]."""
        count, first, _, _ = self._seen.get(frame_id, (0, now, now, b""))
        self._seen[frame_id] = (count + 1, first, now, data)
        if channel := self._channels.get(frame_id):
            channel.accept(data)

    def table(self) -> Table:
        """One row per message that was seen."""
        table = Table(box=SIMPLE_HEAD, pad_edge=False)
        for head in ("id", "message", "frames", "1/s", "E2E", "lost", "bad", "signals"):
            table.add_column(head, justify="right" if head in ("frames", "1/s", "lost", "bad") else "left")
        for frame_id in sorted(self._seen):
            count, first, last, data = self._seen[frame_id]
            rate = f"{(count - 1) / (last - first):.1f}" if last > first else ""
            table.add_row(f"{frame_id:03X}", *self._row(frame_id, count, rate, data))
        return table

    def _row(self, frame_id: int, count: int, rate: str, data: bytes) -> tuple[str, ...]:
        channel = self._channels.get(frame_id)
        if channel is None:
            known = self._messages.get(frame_id)
            shown = self._signals(frame_id, data) if known and known.length == len(data) else data.hex(" ")
            return (f"{known.name} (not ours)" if known else "not ours", str(count), rate, "", "", "", shown)
        checks = channel.receiver.counts
        bad = checks.total() - sum(checks[status] for status in _GOOD) - checks[CheckStatus.OKSOMELOST]
        signals = self._signals(frame_id, data) if len(data) == channel.message.length else data.hex(" ")
        lost = str(channel.receiver.lost)
        return (channel.message.name, str(count), rate, channel.state.name, lost, str(bad), signals)

    def _signals(self, frame_id: int, data: bytes) -> str:
        message = self._messages[frame_id]
        values = message.decode(data)
        assert isinstance(values, dict)
        units = {signal.name: f" {signal.unit}" if signal.unit else "" for signal in message.signals}
        shown = [name for name in values if not name.endswith(("_CRC", "_Counter"))]
        short = {name: name.partition("_")[2] if message.name in messages() else name for name in shown}
        return ", ".join(f"{short[name]} {_text(values[name])}{units[name]}" for name in shown)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def monitor(
    bus: Bus,
    described: BusDescription | None,
    duration: float | None,
    candump: str | None,
    log: Path | None,
    overwrite: bool = False,
) -> None:
    """Watch a bus until `duration` is over, or for ever; the last table stays.

    Args:
        bus: Open.
        described: What travels on it; None for our own messages.
        duration: In [s]; None for ever.
        candump: File for candump's lines, "-" for the terminal instead of the table; None for none.
        log: File for the frames; None for none.
        overwrite: Whether these files may be there already.

    Raises:
        InputError: A file cannot be written, or is there already.
    """
    observer, began = Observer(described), time.monotonic()
    with ExitStack() as resources:
        logs = [resources.enter_context(open_log(log, overwrite))] if log else []
        if candump == "-":
            logs.append(CandumpWriter(sys.stdout))
        elif candump:
            logs.append(CandumpWriter(resources.enter_context(_new_text(Path(candump), overwrite))))
        live = None
        if candump != "-" and Console().is_terminal:
            live = resources.enter_context(Live(observer.table(), refresh_per_second=1.0 / _REFRESH))
        while duration is None or time.monotonic() < began + duration:
            _watch(bus, observer, logs, time.monotonic() + _REFRESH)
            if live:
                live.update(observer.table())
            if candump == "-":
                sys.stdout.flush()
    if candump != "-" and not Console().is_terminal:
        Console(width=200).print(observer.table())


def _new_text(path: Path, overwrite: bool) -> TextIO:
    try:
        return path.open("w" if overwrite else "x", encoding="ascii", newline="\n")
    except FileExistsError as error:
        raise InputError(str(path), "is there already", "another name, or --overwrite") from error
    except OSError as error:
        raise InputError(str(path), f"cannot be written: {error.strerror}") from error


def _watch(bus: Bus, observer: Observer, logs: list, until: float) -> None:
    while (left := until - time.monotonic()) > 0.0:
        message = bus.receive(left)
        if message is None:
            return
        if bus.is_ours(message):
            observer.add(key_of(message), bytes(message.data), time.monotonic())
        if not message.channel or isinstance(message.channel, int):
            message.channel = bus.spec.partition(":")[2]
        for log in logs:
            log.on_message_received(message)
