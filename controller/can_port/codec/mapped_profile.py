"""Where the bits of somebody else's signals are, and how counter and checksum protect their message."""

from dataclasses import dataclass

from cantools.database.can import Message, Signal

from sidestep.controller.can_port.codec import mapping as m
from sidestep.controller.can_port.codec.foreign import signal_named
from sidestep.controller.can_port.protection.checksums import Parameters, Rule, rule_named
from sidestep.plant_models.errors import InputError


@dataclass(frozen=True)
class Field:
    """Where the bits of a signal are, in frames of any length.

    Attributes:
        bits: Byte and bit in it, the least significant first.
    """

    bits: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, signal: Signal) -> "Field":
        """Of a signal of the database; a Motorola signal starts at its most significant bit."""
        if signal.byte_order == "little_endian":
            return cls(tuple(divmod(signal.start + k, 8) for k in range(signal.length)))
        first = 8 * (signal.start // 8) + 7 - signal.start % 8
        places = [first + k for k in reversed(range(signal.length))]
        return cls(tuple((place // 8, 7 - place % 8) for place in places))

    @property
    def byte(self) -> int:
        """The first byte that it touches."""
        return min(byte for byte, _ in self.bits)

    def get(self, data: bytes | bytearray) -> int:
        """The raw number, unsigned."""
        return sum((data[byte] >> bit & 1) << k for k, (byte, bit) in enumerate(self.bits))

    def put(self, data: bytearray, raw: int) -> None:
        """Write the raw number, its lowest bits if there are too many."""
        for k, (byte, bit) in enumerate(self.bits):
            data[byte] = data[byte] & ~(1 << bit) | (raw >> k & 1) << bit


@dataclass(frozen=True)
class MappedProfile:
    """Counter and checksum of somebody else's message.

    Attributes:
        frame_id: Identifier without its flag.
        counter: Where the counter is; None without.
        values: Its values in the order in which they are sent.
        checksum: Where the checksum is; None without.
        rule, parameters: How it is made.
    """

    frame_id: int
    counter: Field | None
    values: tuple[int, ...]
    checksum: Field | None
    rule: Rule | None
    parameters: Parameters
    header_bits = 0

    @property
    def counters(self) -> int:
        """How many values the counter has; 1 without."""
        return len(self.values)

    def protect(self, data: bytearray, counter: int) -> None:
        """Write counter and checksum into `data`."""
        if self.counter:
            self.counter.put(data, self.values[counter])
        if self.checksum:
            self.checksum.put(data, self._sum(data))

    def counter_of(self, data: bytes | bytearray) -> int | None:
        """The counter's place in its order if the frame is intact; None if checksum or counter do not fit."""
        if self.checksum and self.checksum.get(data) != self._sum(data):
            return None
        value = self.counter.get(data) if self.counter else self.values[0]
        return self.values.index(value) if value in self.values else None

    def _sum(self, data: bytes | bytearray) -> int:
        assert self.checksum is not None
        assert self.rule is not None
        bare = bytearray(data)
        self.checksum.put(bare, 0)
        counter = self.counter.get(bare) if self.counter else 0
        return self.rule(self.frame_id, bytes(bare), self.checksum.byte, counter, self.parameters)


def profile_of(message: Message, table: m.MappedTable, where: str) -> MappedProfile:
    """Protection of a message.

    Raises:
        InputError: A signal, a rule or a value in the table cannot be used.
    """
    counter, values = None, (0,)
    if table.counter:
        signal = signal_named(message, table.counter.signal, f"{where}.counter.signal")
        counter, values = Field.of(signal), _values(table.counter, (1 << signal.length) - 1, f"{where}.counter")
    checksum, rule, parameters = None, None, Parameters()
    if table.checksum:
        given = table.checksum
        signal = signal_named(message, given.signal, f"{where}.checksum.signal")
        checksum, rule = Field.of(signal), rule_named(given.rule, f"{where}.checksum.rule")
        try:
            ids = bytes.fromhex(given.data_ids)
        except ValueError:
            raise InputError(f"{where}.checksum.data_ids", f"{given.data_ids!r} is not hexadecimal") from None
        if given.rule == "autosar-2" and not ids:
            raise InputError(f"{where}.checksum.data_ids", "missing", "one byte for every counter, hexadecimal")
        width = max(8, signal.length)
        parameters = Parameters(
            width, given.polynomial, given.initial, given.reflect, given.xor_out, given.data_id, ids
        )  # fmt: skip
    return MappedProfile(message.frame_id, counter, values, checksum, rule, parameters)


def _values(counter: m.Counter, highest: int, where: str) -> tuple[int, ...]:
    last = highest if counter.last is None else counter.last
    if not (0 <= last <= highest and 0 <= counter.start <= last and counter.step):
        raise InputError(
            where, f"start {counter.start}, step {counter.step}, last {last}", f"0 to {highest}, step not 0"
        )
    found, value = [], counter.start
    while value not in found:
        found.append(value)
        value = (value + counter.step) % (last + 1)
    kept = tuple(value for value in found if value not in counter.skip)
    if not kept:
        raise InputError(where, "skips every value")
    return kept
