"""The messages of steer.dbc: saturating, protected encoding and decoding without any I/O."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import cantools.database
from cantools.database.can import Database, Message, Signal

from sidestep.controller.can_port.e2e import Profile, Profile2

DBC = Path(__file__).parent / "steer.dbc"
"""The database file, the one description of every message."""


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


@dataclass(frozen=True)
class ProtectedMessage:
    """One message of the database with its end-to-end protection.

    Attributes:
        name: Name in the database.
        frame_id: CAN identifier.
        length: Bytes of the frame.
        cycle: Time between two frames, in [s].
        profile: End-to-end protection.
        signals: Every signal behind the protection header.
    """

    name: str
    frame_id: int
    length: int
    cycle: float
    profile: Profile
    signals: tuple[PackedSignal, ...]

    def encode(self, values: Mapping[str, float], counter: int) -> bytes:
        """Protected frame that carries `values`.

        What is out of range goes to the nearer limit. If any value is not a finite number the whole frame
        carries the start values, which are the safe ones (enable or valid = 0).

        Args:
            values: Physical value of every signal by name.
            counter: Alive counter; taken modulo the range of the profile.
        """
        word = 0
        finite = all(map(isfinite, values.values()))
        for name, start, mask, _, scale, low, high, safe in self.signals:
            steps = values[name] / scale if finite else safe
            raw = low if steps < low else high if steps > high else round(steps)
            word |= (raw & mask) << start
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

    def highest(self, name: str) -> float:
        """Largest physical value that signal `name` can carry."""
        return next(s.high * s.scale for s in self.signals if s.name == name)


@cache
def messages() -> dict[str, ProtectedMessage]:
    """The messages of steer.dbc by name."""
    return {message.name: _protected(message) for message in load_dbc().messages}


def load_dbc() -> Database:
    """steer.dbc as a cantools database."""
    database = cantools.database.load_file(DBC, strict=True)
    assert isinstance(database, Database)
    return database


def _protected(message: Message) -> ProtectedMessage:
    assert message.dbc is not None
    profile = Profile2(bytes.fromhex(str(message.dbc.attributes["E2EDataIDs"].value)))
    payload = [s for s in message.signals if s.start >= profile.header_bits]
    return ProtectedMessage(
        name=message.name,
        frame_id=message.frame_id,
        length=message.length,
        cycle=1e-3 * (message.cycle_time or 0),
        profile=profile,
        signals=tuple(map(_packed, payload)),
    )


def _packed(signal: Signal) -> PackedSignal:
    scale = signal.scale
    return PackedSignal(
        name=signal.name,
        start=signal.start,
        mask=(1 << signal.length) - 1,
        sign_bit=1 << signal.length - 1 if signal.is_signed else 0,
        scale=scale,
        low=round((signal.minimum or 0) / scale),
        high=round((signal.maximum or 0) / scale),
        safe=int(signal.raw_initial or 0),
    )
