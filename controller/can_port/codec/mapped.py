"""One message of somebody else's as ours see theirs: our signals in, a protected frame out, and back."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import atan, degrees, inf, isfinite, nan, tan

from cantools.database.can import Message, Signal

from sidestep.controller.can_port.codec import mapping as m
from sidestep.controller.can_port.codec.foreign import signal_named
from sidestep.controller.can_port.codec.mapped_profile import Field, MappedProfile
from sidestep.plant_models.errors import InputError

UNITS = {
    "rad": 1.0, "deg": degrees(1.0), "degree": degrees(1.0), "degrees": degrees(1.0), "°": degrees(1.0),
    "rad/s": 1.0, "deg/s": degrees(1.0), "°/s": degrees(1.0), "degree/s": degrees(1.0), "deg/sec": degrees(1.0),
    "m/s": 1.0, "km/h": 3.6, "kph": 3.6, "kmh": 3.6, "mph": 3600.0 / 1609.344,
    "1/m": 1.0, "1/meter": 1.0, "rad/m": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "g": 1.0 / 9.80665, "": 1.0,
}  # fmt: skip
"""How much of a unit one of SI is."""


_TWO_SIDED = (
    "SteerCmd_Angle", "DriveCmd_Acceleration", "SteerStatus_Angle", "SteerStatus_Rate", "VehDyn_YawRate",
    "VehDyn_AccLat",
)  # fmt: skip


@dataclass(frozen=True)
class Number:
    """One quantity in its signal.

    Attributes:
        name: Our signal.
        signal: Theirs.
        where: Its bits.
        ratio, offset: `physical = ratio * value + offset`.
        sign: Where the sign is, if the signal has none, and its raw value to the right.
        limits: Smallest and largest raw number.
        to_theirs, to_ours: What it is taken through before and after.
    """

    name: str
    signal: Signal
    where: Field
    ratio: float
    offset: float
    limits: tuple[int, int]
    sign: tuple[Field, int] | None = None
    to_theirs: Callable[[float], float] = field(default=lambda value: value)
    to_ours: Callable[[float], float] = field(default=lambda value: value)

    def put(self, data: bytearray, value: float) -> None:
        """Write a value; out of range it goes to the nearer limit."""
        physical = self.ratio * self.to_theirs(value) + self.offset
        if self.sign:
            bit, negative = self.sign
            bit.put(data, negative if physical < 0.0 else 1 - negative)
            physical = abs(physical)
        low, high = self.limits
        steps = (physical - self.signal.offset) / self.signal.scale
        self.where.put(data, round(min(max(steps, low), high)))

    def get(self, data: bytes | bytearray) -> float:
        """Read the value."""
        raw = self.where.get(data)
        if self.signal.is_signed and raw >> self.signal.length - 1:
            raw -= 1 << self.signal.length
        physical = raw * self.signal.scale + self.signal.offset
        if self.sign and self.sign[0].get(data) == self.sign[1]:
            physical = -physical
        return self.to_ours((physical - self.offset) / self.ratio)


def _limits(signal: Signal, neutral: float, two_sided: bool) -> tuple[int, int]:
    """Raw range: of the bits, within the limits that the database gives, if these leave room on both sides."""
    low = -(1 << signal.length - 1) if signal.is_signed else 0
    high = low + (1 << signal.length) - 1
    if signal.minimum is None or signal.maximum is None or signal.maximum <= signal.minimum:
        return low, high
    if two_sided and not signal.minimum < neutral < signal.maximum:
        return low, high  # [0|1] and the like behind everything
    ends = sorted(round((end - signal.offset) / signal.scale) for end in (signal.minimum, signal.maximum))
    return max(low, ends[0]), min(high, ends[1])


def number_of(name: str, message: Message, quantity: m.Quantity, where: str) -> Number:
    """A quantity of a mapping file in its message.

    Raises:
        InputError: Signal or unit are not known, or the signal is not a whole number of steps.
    """
    signal = signal_named(message, quantity.signal, f"{where}.signal")
    unit = (quantity.unit or signal.unit or "").strip().lower()
    if unit not in UNITS:
        raise InputError(f"{where}.unit", f"unknown unit {unit!r} of {signal.name}", ", ".join(u for u in UNITS if u))
    if signal.is_float or not isfinite(quantity.ratio) or quantity.ratio == 0.0 or signal.scale == 0:
        raise InputError(where, f"{signal.name} cannot carry it", "a signal of whole steps, a ratio other than 0")
    sign = None
    if quantity.sign:
        bit = signal_named(message, quantity.sign.signal, f"{where}.sign.signal")
        sign = Field.of(bit), quantity.sign.negative
    side = 1.0 if quantity.positive == "left" else -1.0
    limits = _limits(signal, quantity.offset, name in _TWO_SIDED and sign is None)
    return Number(name, signal, Field.of(signal), side * quantity.ratio * UNITS[unit], quantity.offset, limits, sign)


def as_curvature(number: Number, wheelbase: float) -> Number:
    """The road-wheel angle as the curvature of a slow turn."""
    return Number(
        number.name, number.signal, number.where, number.ratio, number.offset, number.limits, number.sign,
        lambda angle: tan(angle) / wheelbase, lambda curvature: atan(curvature * wheelbase),
    )  # fmt: skip


@dataclass(frozen=True)
class MappedMessage:
    """A message of a mapping file, in the place of one of ours.

    Attributes:
        name: In the database.
        frame_id: Identifier, `EXTENDED` added to one of 29 bits.
        length, cycle, profile, sender: As those of a `ProtectedMessage`.
        is_fd: Whether it is a CAN FD frame.
        base: The frame with its constants.
        numbers: Quantities.
        switches: What has to be on, and its raw values.
        states: Signal of the actuator's state, raw values by state.
    """

    name: str
    frame_id: int
    length: int
    cycle: float
    profile: MappedProfile
    sender: str
    is_fd: bool
    base: bytes
    numbers: tuple[Number, ...]
    switches: tuple[tuple[Field, int, int], ...] = ()
    states: tuple[Field, Mapping[int, tuple[int, ...]]] | None = None
    fault: tuple[Field, int, int] | None = None
    tied = False
    reserved = 0

    def encode(self, values: Mapping[str, float], counter: int) -> bytes:
        """Protected frame of our signals by name; if one is not finite all are 0, and it is not enabled."""
        data = bytearray(self.base)
        usable = all(isfinite(values.get(number.name, nan)) for number in self.numbers)
        enable = usable and bool(values.get("SteerCmd_Enable", True))
        for number in self.numbers:
            number.put(data, values[number.name] if usable else 0.0)
        for where, on, off in self.switches:
            where.put(data, on if enable else off)
        state = int(values.get("SteerStatus_State", _FAULT))
        if self.states:
            where, numbers = self.states
            where.put(data, numbers.get(state, numbers.get(_FAULT, (0,)))[0])
        if self.fault:
            where, on, off = self.fault
            where.put(data, on if state == _FAULT else off)
        self.profile.protect(data, counter % self.profile.counters)
        return bytes(data)

    def decode(self, data: bytes | bytearray) -> dict[str, float]:
        """Our signals of a frame that a `Receiver` has checked; of a command also those that it does not carry."""
        values = {number.name: number.get(data) for number in self.numbers}
        if self.states:
            where, numbers = self.states
            raw = where.get(data)
            found = [state for state, of_state in numbers.items() if raw in of_state]
            values["SteerStatus_State"] = found[0] if found else _FAULT
        if self.fault and self.fault[0].get(data) == self.fault[1]:
            values["SteerStatus_State"] = _FAULT
        if self.sender == "CTRL":
            enable = all(where.get(data) == on for where, on, _ in self.switches)
            if not enable:
                values["SteerCmd_Angle"] = 0.0
            values = _UNTOLD | values
            values |= {"SteerCmd_Enable": enable, "SteerCmd_Mode": _ANGLE if enable else _STANDBY}
            values["SteerCmd_Status"] = 0 if enable else 3
        return values


_FAULT, _STANDBY, _ANGLE = 5, 1, 2  # numbers of the value tables of steer.dbc
_UNTOLD = {"SteerCmd_RateLimit": inf, "SteerCmd_TargetSpeed": nan, "SteerCmd_Answers": 0.63}
