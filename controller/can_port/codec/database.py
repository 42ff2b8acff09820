"""The messages of steer.dbc: saturating, protected encoding and decoding without any I/O.

The file describes classic CAN with E2E Profile 2. The two other protections are derived from it: Profile 5 has a
longer header and therefore CAN FD frames; "none" leaves the header of Profile 2 empty.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from math import isfinite
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import cantools.database
from cantools.database.can import Database, Message, Signal

from sidestep.controller.can_port.protection.e2e import Profile, Profile2, Profile5, Unprotected

DBC = Path(__file__).parents[1] / "steer.dbc"
"""The database file, the one description of every message."""

CYCLE = 0.01
"""Time between two cycles of a node, in [s]: that of every message but CTRL_STATUS."""

Frame = tuple[int, bytes]
"""Identifier and data; `EXTENDED` is added to an identifier of 29 bits."""

EXTENDED = 0x80000000
"""Flag of an identifier of 29 bits, as Linux has it."""

EXACT = "STATE_EXACT"
"""Name of the message that is in logs only."""

Protection = Literal["P02", "P05", "none"]
"""AUTOSAR E2E Profile 2 on classic CAN, Profile 5 on CAN FD, or nothing."""

_STANDARD_CAN_FD = 14  # number in the enumeration that Vector's tools know
_FD_LENGTH = 12  # the shortest CAN FD frame that takes the longer header and 52 bits of payload


class PackedSignal(NamedTuple):
    """One signal's place in the frame, little-endian and without offset, as all of ours are.

    Attributes:
        name: Name in the database.
        start: Bit number of the least significant bit.
        mask: As many ones as the signal has bits.
        sign_bit: The most significant of them if the signal is signed, else 0.
        scale: Physical value of one step.
        low, high: Range, in steps.
        safe: Start value, in steps.
    """

    name: str
    start: int
    mask: int
    sign_bit: int
    scale: float
    low: int
    high: int
    safe: int


class BusMessage(Protocol):
    """A message that one of ours may be, of steer.dbc or of a mapping file; the members are `ProtectedMessage`'s."""

    @property
    def name(self) -> str:
        """Name in the database."""
        ...

    @property
    def frame_id(self) -> int:
        """Identifier of its frames."""
        ...

    @property
    def length(self) -> int:
        """Bytes of data."""
        ...

    @property
    def cycle(self) -> float:
        """Time between two frames, in [s]."""
        ...

    @property
    def profile(self) -> Profile:
        """Its protection."""
        ...

    @property
    def sender(self) -> str:
        """Node that sends it."""
        ...

    @property
    def tied(self) -> bool:
        """Whether its counter is that of the sample or command that it belongs to."""
        ...

    @property
    def reserved(self) -> int:
        """See `ProtectedMessage`."""
        ...

    @property
    def is_fd(self) -> bool:
        """Whether it needs CAN FD."""
        ...

    def encode(self, values: Mapping[str, float], counter: int) -> bytes:
        """Data of a frame with these physical values."""
        ...

    def decode(self, data: bytes | bytearray) -> dict[str, float]:
        """Physical values of a frame."""
        ...


Catalogue = Mapping[str, BusMessage]
"""Messages by name; that which steers is STEER_CMD whoever made it."""


@dataclass(frozen=True)
class ProtectedMessage:
    """One message of the database with its end-to-end protection.

    Attributes:
        name: Name in the database.
        frame_id: CAN identifier.
        length: Bytes of the frame; more than 8 make it a CAN FD frame.
        cycle: Time between two frames, in [s].
        profile: End-to-end protection.
        signals: Every signal behind the protection header.
        sender: Name of the node that sends it.
        tied: Whether its alive counter is that of the sample or command it belongs to.
    """

    name: str
    frame_id: int
    length: int
    cycle: float
    profile: Profile
    signals: tuple[PackedSignal, ...]
    sender: str
    tied: bool = True

    def encode(self, values: Mapping[str, float], counter: int) -> bytes:
        """Protected frame that carries `values`.

        What is out of range goes to the nearer limit. If any value is not a finite number the whole frame
        carries the start values, which are the safe ones (enable or valid = 0).

        Args:
            values: Physical value of every signal by name.
            counter: Alive counter; taken modulo the range of the profile.
        """
        word = 0
        for name, start, mask, _, scale, low, high, _ in self.signals:
            value = values[name]
            if not isfinite(value):
                word = self._safe
                break
            steps = value / scale
            word |= ((low if steps < low else high if steps > high else round(steps)) & mask) << start
        data = bytearray(word.to_bytes(self.length, "little"))
        self.profile.protect(data, counter % self.profile.counters)
        return bytes(data)

    def decode(self, data: bytes | bytearray) -> dict[str, float]:
        """Physical values of every signal of a frame that a `Receiver` has checked."""
        word = int.from_bytes(data, "little")
        values = {}
        for name, start, mask, sign_bit, scale, _, _, _ in self.signals:
            raw = (word >> start) & mask
            values[name] = (raw - ((raw & sign_bit) << 1)) * scale
        return values

    @property
    def reserved(self) -> int:
        """Mask of the bits that neither header nor signals use, which are sent as 0; byte 0 is the lowest."""
        return self._reserved

    @cached_property
    def _reserved(self) -> int:
        used = (1 << self.profile.header_bits) - 1
        for signal in self.signals:
            used |= signal.mask << signal.start
        return ~used & ((1 << 8 * self.length) - 1)

    @cached_property
    def _safe(self) -> int:
        """The start values, packed."""
        return sum((signal.safe & signal.mask) << signal.start for signal in self.signals)

    @property
    def is_fd(self) -> bool:
        """Whether only CAN FD can carry the frame."""
        return self.length > 8

    def highest(self, name: str) -> float:
        """Largest physical value that signal `name` can carry."""
        return next(s.high * s.scale for s in self.signals if s.name == name)


def messages(protection: Protection = "P02") -> dict[str, ProtectedMessage]:
    """The protected messages of steer.dbc by name: those that travel; the same objects at every call."""
    return _messages(protection)


@cache
def _messages(protection: Protection) -> dict[str, ProtectedMessage]:
    travelling = (message for message in load_dbc(protection).messages if message.name != EXACT)
    return {message.name: _protected(message, protection) for message in travelling}


def load_dbc(protection: Protection = "P02") -> Database:
    """steer.dbc as a cantools database, with headers and attributes as `protection` has them."""
    database = cantools.database.load_file(DBC)
    assert isinstance(database, Database)
    for message in database.messages:
        if message.name == EXACT:
            continue
        if protection == "P05":
            _lengthen(message)
        elif protection == "none":
            _set_attributes(message, E2EProfile=0, E2EDataIDs="")
    database.refresh()
    return database


def _lengthen(message: Message) -> None:
    """Turn the header of Profile 2 into that of Profile 5: 16-bit CRC, 8-bit counter, payload behind them."""
    message.is_fd, message.length = True, _FD_LENGTH
    for signal in message.signals:
        if signal.start >= Profile2.header_bits:
            signal.start += Profile5.header_bits - Profile2.header_bits
        else:
            signal.start, signal.length = 2 * signal.start, 2 * signal.length
            signal.maximum = (1 << signal.length) - 1
    _set_attributes(message, E2EProfile=2, E2EDataIDs=f"{message.frame_id:04x}", VFrameFormat=_STANDARD_CAN_FD)


def _set_attributes(message: Message, **values: int | str) -> None:
    assert message.dbc is not None
    for name, value in values.items():
        attribute: Any = message.dbc.attributes[name]
        attribute.value = value


def _protected(message: Message, protection: Protection) -> ProtectedMessage:
    assert message.dbc is not None
    assert message.cycle_time is not None
    (sender,) = message.senders
    data_ids = bytes.fromhex(str(message.dbc.attributes["E2EDataIDs"].value))
    profile: Profile = Unprotected()
    if protection != "none":
        profile = Profile2(data_ids) if protection == "P02" else Profile5(int.from_bytes(data_ids, "big"))
    payload = [s for s in message.signals if s.start >= profile.header_bits]
    return ProtectedMessage(
        name=message.name,
        frame_id=message.frame_id,
        length=message.length,
        cycle=1e-3 * message.cycle_time,
        profile=profile,
        signals=tuple(map(_packed, payload)),
        sender=sender,
    )


def _packed(signal: Signal) -> PackedSignal:
    scale = signal.scale
    assert signal.minimum is not None
    assert signal.maximum is not None
    return PackedSignal(
        name=signal.name,
        start=signal.start,
        mask=(1 << signal.length) - 1,
        sign_bit=1 << signal.length - 1 if signal.is_signed else 0,
        scale=scale,
        low=round(signal.minimum / scale),
        high=round(signal.maximum / scale),
        safe=int(signal.raw_initial or 0),
    )
