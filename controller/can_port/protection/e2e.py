"""End-to-end protection of one message: AUTOSAR E2E profiles and the receiver's check of each frame.

Profile 2 (classic CAN) and Profile 5 (CAN FD) of AUTOSAR FO PRS_E2EProtocol; the CRCs are autosar-e2e's.
What a receiver makes of a series of checks is in `e2e_state`.
"""

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from e2e.p02 import e2e_p02_check, e2e_p02_protect
from e2e.p05 import e2e_p05_check, e2e_p05_protect


class CheckStatus(StrEnum):
    """Outcome of the check of one frame, named as in the AUTOSAR specification."""

    OK = "OK"  # intact and next in line
    OKSOMELOST = "OKSOMELOST"  # intact, a tolerable number of frames was lost before it
    REPEATED = "REPEATED"  # intact, but the counter stands still
    WRONGSEQUENCE = "WRONGSEQUENCE"  # intact, but the counter jumped too far
    ERROR = "ERROR"  # wrong CRC, data ID or length
    NONEWDATA = "NONEWDATA"  # nothing arrived
    INITIAL = "INITIAL"  # the first intact frame: there is no counter yet to compare with


ACCEPTED = frozenset({CheckStatus.OK, CheckStatus.OKSOMELOST})
"""The outcomes whose data may be used."""


@dataclass(frozen=True)
class Profile2:
    """E2E Profile 2: CRC-8-H2F in byte 0, 4-bit counter in the low half of byte 1.

    Attributes:
        data_ids: 16 bytes, the one picked by the counter enters the CRC; tells messages apart.
    """

    data_ids: bytes
    header_bits = 12
    counters = 16

    def protect(self, data: bytearray, counter: int) -> None:
        """Write counter and CRC into `data`."""
        data[1] = (data[1] & 0xF0) | counter
        e2e_p02_protect(data, self.data_ids, increment_counter=False)

    def counter_of(self, data: bytes | bytearray) -> int | None:
        """The counter of an intact frame; None if the CRC does not fit."""
        return data[1] & 0x0F if e2e_p02_check(data, self.data_ids) else None


@dataclass(frozen=True)
class Profile5:
    """E2E Profile 5: CRC-16-CCITT in bytes 0 and 1, 8-bit counter in byte 2.

    Attributes:
        data_id: 16-bit number that enters the CRC; tells messages apart.
    """

    data_id: int
    header_bits = 24
    counters = 256

    def protect(self, data: bytearray, counter: int) -> None:
        """Write counter and CRC into `data`."""
        data[2] = counter
        e2e_p05_protect(data, self.data_id, increment_counter=False)

    def counter_of(self, data: bytes | bytearray) -> int | None:
        """The counter of an intact frame; None if the CRC does not fit."""
        return data[2] if e2e_p05_check(data, self.data_id) else None


@dataclass(frozen=True)
class Unprotected:
    """No protection: the layout of Profile 2 with an empty header. Every frame counts as the next in line."""

    header_bits = 12
    counters = 1

    def protect(self, data: bytearray, counter: int) -> None:
        """Leave `data` as it is."""

    def counter_of(self, data: bytes | bytearray) -> int:
        """Always 0."""
        return 0


class Profile(Protocol):
    """What protects a message: ours of AUTOSAR, or somebody else's."""

    @property
    def header_bits(self) -> int:
        """Bits ahead of the signals that counter and CRC take."""
        ...

    @property
    def counters(self) -> int:
        """How many values the counter has; 1 if there is none."""
        ...

    def protect(self, data: bytearray, counter: int) -> None:
        """Write counter and CRC into `data`."""
        ...

    def counter_of(self, data: bytes | bytearray) -> int | None:
        """The counter of an intact frame; None if it is not intact."""
        ...


class Receiver:
    """Receiving end of one protected message: compares each frame with the one before.

    The counter of an intact frame, whatever the outcome, is what the next one is compared with
    (E2E_P05Check; Profile 2 follows the same rule here).

    Args:
        profile: Protection of the message.
        length: Bytes of the message.
        max_delta: Largest step of the counter that is still OKSOMELOST.

    Attributes:
        counts: How often each outcome came.
        lost: Frames that the steps of the counter say were lost between accepted ones.
        counter: Of the last intact frame; None before the first.
    """

    def __init__(self, profile: Profile, length: int, max_delta: int = 3):
        self.profile, self.length, self.max_delta = profile, length, max_delta
        self.counts: Counter[CheckStatus] = Counter()
        self.lost = 0
        self.counter: int | None = None

    def check(self, data: bytes | bytearray | None) -> CheckStatus:
        """Check one frame, or None for a cycle in which nothing arrived."""
        status = self._compare(data)
        self.counts[status] += 1
        return status

    def _compare(self, data: bytes | bytearray | None) -> CheckStatus:
        if data is None:
            return CheckStatus.NONEWDATA
        counter = self.profile.counter_of(data) if len(data) == self.length else None
        if counter is None:
            return CheckStatus.ERROR
        last, self.counter = self.counter, counter
        if self.profile.counters == 1:
            return CheckStatus.OK
        if last is None:
            return CheckStatus.INITIAL
        return self._judge((counter - last) % self.profile.counters)

    def _judge(self, delta: int) -> CheckStatus:
        if delta == 0:
            return CheckStatus.REPEATED
        if delta > self.max_delta:
            return CheckStatus.WRONGSEQUENCE
        self.lost += delta - 1
        return CheckStatus.OK if delta == 1 else CheckStatus.OKSOMELOST
