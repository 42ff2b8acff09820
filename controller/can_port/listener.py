"""The controller's ear: puts the vehicle's state together from its frames."""

from collections.abc import Iterable, Mapping
from math import inf
from typing import NamedTuple

from sidestep.controller.can_port.bus.channel import Channel
from sidestep.controller.can_port.codec.database import CYCLE, BusMessage, Catalogue, Frame
from sidestep.controller.can_port.codec.messages import ANSWERS
from sidestep.controller.can_port.codec.samples import SAMPLES, vehicle_state
from sidestep.controller.can_port.protection.e2e_state import E2EState
from sidestep.plant_models.signals import VehicleState

STALE = 0.05
"""Oldest input that the controller steers by, in [s]."""

_INSTANT = 1e-9  # two times closer than this are the same, in [s]
_UNDER_WAY = 3  # samples that may be incomplete at the same time
_LEAP = 500  # a vehicle's clock that moves on by more cycles than this was started again
VEHICLE_NODES = ("EPS", "VEH")
"""Names of the nodes that the vehicle's end stands for."""


class Sample(NamedTuple):
    """The vehicle's state at one instant of its own clock.

    Attributes:
        number: Cycles since the first sample that was heard.
        drive: How often the vehicle's clock has started again since.
        state: The state; its time is `number` in [s].
        answers: What a command that answers it says, see `encode_steer_command`.
    """

    number: int
    drive: int
    state: VehicleState
    answers: int | None


class Assembler:
    """Samples from intact frames, in the order of the bus. Time plays no part: a log gives the same samples as a drive.

    A sample is whole when every message that the alive counter ties to it has come; other makers' messages, which
    nothing ties together, count with what they said last.

    Args:
        catalogue: The messages in use.

    Attributes:
        valid: Whether the last whole sample said that it is to be used.
    """

    def __init__(self, catalogue: Catalogue):
        sent = {message.frame_id: message for message in catalogue.values() if message.sender in VEHICLE_NODES}
        self.messages: dict[int, BusMessage] = sent
        self.valid = False
        self._tied = frozenset(frame_id for frame_id, message in sent.items() if message.tied)
        self._loose: dict[str, float] = {}
        self._parts: dict[int, dict[int, bytes | bytearray]] = {}  # counter -> identifier -> data
        self._last: Sample | None = None
        self._clock = 0

    def add(self, frame_id: int, counter: int, data: bytes | bytearray) -> Sample | None:
        """Take in an intact frame; the sample that it completes."""
        if frame_id not in self._tied:
            self._loose |= self.messages[frame_id].decode(data)
            return None
        parts = self._parts.setdefault(counter, {})
        parts[frame_id] = data
        if len(parts) == len(self._tied):
            self._parts.clear()
            return self._whole(parts)
        if len(self._parts) > _UNDER_WAY:
            del self._parts[next(iter(self._parts))]
        return None

    def _whole(self, parts: Mapping[int, bytes | bytearray]) -> Sample | None:
        values: dict[str, float] = {}
        for frame_id, data in parts.items():
            values |= self.messages[frame_id].decode(data)
        values |= self._loose
        clock, last = round(values["VehHeading_Sample"] / CYCLE), self._last
        number, drive = 0, 0
        if last:
            passed = (clock - self._clock) % SAMPLES if clock != SAMPLES else 1
            known = passed <= _LEAP
            number, drive = last.number + (passed if known else 1), last.drive + (not known)
        state = None
        if "SteerStatus_Angle" in values:
            state = vehicle_state(values, number * CYCLE, last.state.yaw if last else 0.0)
        self.valid = state is not None
        if state is None or (last and number == last.number):  # or the same once more
            return None
        self._clock = clock
        self._last = Sample(number, drive, state, None if clock == SAMPLES else clock % ANSWERS)
        return self._last


class StateListener:
    """The vehicle's state as received; only what is intact, whole and declared valid counts.

    Args:
        catalogue: The messages in use.

    Attributes:
        channels: Receiving ends by identifier.
        sample: The newest sample; None before the first.
        arrived: When that was whole, in [s].
    """

    def __init__(self, catalogue: Catalogue):
        self._assembler = Assembler(catalogue)
        self.channels = {frame_id: Channel(message) for frame_id, message in self._assembler.messages.items()}
        self.sample: Sample | None = None
        self.arrived = -inf
        self._heard = {frame_id: -inf for frame_id, message in self._assembler.messages.items() if not message.tied}

    @property
    def said_valid(self) -> bool:
        """Whether the last whole sample said that it is to be used."""
        return self._assembler.valid

    def fresh(self, time: float) -> bool:
        """Whether there is a state at `time`, in [s], that may be steered by."""
        return (
            self.sample is not None
            and time - self.arrived <= STALE + _INSTANT
            and all(
                time - heard <= STALE + self.channels[frame_id].message.cycle for frame_id, heard in self._heard.items()
            )
            and all(channel.state is E2EState.VALID for channel in self.channels.values())
        )

    def take(self, time: float, frames: Iterable[Frame]) -> None:
        """Take in what arrived in one cycle that ends at `time`, in [s], oldest first."""
        silent = dict(self.channels)
        for frame_id, data in frames:
            channel = self.channels.get(frame_id)
            if channel is None:
                continue
            silent.pop(frame_id, None)
            if channel.accept(data):
                self._add(time, frame_id, channel.receiver.counter or 0, data)
        for channel in silent.values():
            channel.miss()

    def _add(self, time: float, frame_id: int, counter: int, data: bytes | bytearray) -> None:
        if frame_id in self._heard:
            self._heard[frame_id] = time
        if sample := self._assembler.add(frame_id, counter, data):
            self.sample, self.arrived = sample, time
