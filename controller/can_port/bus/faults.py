"""A faulty bus in virtual time: seeded, so that every case can be run again, from one description.

The same description gives the arguments of `tc netem` for a real vcan, as far as the kernel can do the same.
"""

from dataclasses import dataclass, fields
from heapq import heappop, heappush
from math import inf
from pathlib import Path
from random import Random
from typing import Annotated

from sidestep.controller.can_port.codec.database import BusMessage, Catalogue, Frame, messages
from sidestep.plant_models.documents import read_toml
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.ranges import Range, check

REORDER_DELAY = 0.03
"""How long a frame is held back so that later ones overtake it, in [s]."""

_FOREIGN_IDS = 0x100  # below all of ours: they would win every arbitration
_NETEM = {"loss": "loss", "duplication": "duplicate", "corruption": "corrupt"}


_FLAG = "true or false"

Probability = Annotated[float, Range(0.0, 1.0)]


@dataclass(frozen=True)
class FaultSpec:
    """What goes wrong on the bus; the plain defaults are a bus without faults.

    Every kind of fault draws its own random numbers: one more fault leaves the others where they were.

    Attributes:
        seed: Seed of all random numbers.
        only: Name of the only message it happens to; empty for all.
        start, end: Time in which it happens, in [s].
        loss: Probability that a loss begins at a frame.
        burst: Most frames that are lost in a row then; the number is drawn evenly from 1 to this.
        duplication: Probability that a frame arrives twice.
        delay: Delay of every frame, in [s].
        jitter: Further delay, drawn evenly from 0 to this, in [s].
        reorder: Probability that a frame is held back by `REORDER_DELAY`.
        corruption: Probability that a random set of a frame's bits flips.
        wrong_length: Probability that a frame is cut short.
        masquerade: Probability that a frame is protected as another message.
        counter_jump: Probability that the sender's counter jumps, for good.
        freeze: Whether the sender repeats its last frame.
        stuck: Whether payloads stand still under a good counter and CRC.
        flood: Foreign frames ahead of every frame.
    """

    seed: Annotated[int, Range(0, 2**63 - 1)] = 0
    only: str = ""
    start: Annotated[float, Range(0.0, 1e6, "s")] = 0.0
    end: Annotated[float, Range(0.0, inf, "s")] = inf
    loss: Probability = 0.0
    burst: Annotated[int, Range(1, 10_000)] = 1
    duplication: Probability = 0.0
    delay: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    jitter: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    reorder: Probability = 0.0
    corruption: Probability = 0.0
    wrong_length: Probability = 0.0
    masquerade: Probability = 0.0
    counter_jump: Probability = 0.0
    freeze: bool = False
    stuck: bool = False
    flood: Annotated[int, Range(0, 1000)] = 0

    def __post_init__(self) -> None:
        check(self, "faults")
        for name, kind, allowed in (("freeze", bool, _FLAG), ("stuck", bool, _FLAG), ("only", str, "a text")):
            if not isinstance(value := getattr(self, name), kind):
                raise InputError(f"faults.{name}", f"{value!r}", allowed)
        if not self.end > self.start:
            raise InputError("faults.end", f"{self.end} s", f"> start ({self.start})")
        if self.only and self.only not in messages():
            raise InputError("faults.only", f"unknown message {self.only!r}", ", ".join(messages()))

    @classmethod
    def from_file(cls, path: str | Path) -> "FaultSpec":
        """Read a TOML file with the fields of this class.

        Raises:
            InputError: The file cannot be read, or a key or value in it cannot be used.
        """
        data = read_toml(path)
        names = [f.name for f in fields(cls)]
        for key in data:
            if key not in names:
                raise InputError(f"{path}: {key}", "unknown key", ", ".join(names))
        return cls(**data)

    def netem_arguments(self) -> list[str]:
        """What to give to `tc qdisc add dev vcan0 root netem`.

        Raises:
            InputError: A fault is asked for that netem does not know, or not together with another.
        """
        known = {"seed", "delay", "jitter", "reorder", *_NETEM}
        unknown = [f.name for f in fields(self) if f.name not in known and getattr(self, f.name) != f.default]
        if unknown:
            raise InputError("faults", f"netem has no {', '.join(unknown)}", ", ".join(sorted(known)))
        if self.reorder and (self.delay or self.jitter):
            raise InputError("faults", "netem reorders by means of its delay", "reorder, or delay and jitter")
        arguments = [word for name, netem in _NETEM.items() for word in _percent(netem, getattr(self, name))]
        if self.reorder:  # netem delays all but the share it is given
            arguments += ["delay", f"{REORDER_DELAY * 1e3:g}ms", *_percent("reorder", 1.0 - self.reorder)]
        elif self.delay or self.jitter:  # netem's jitter goes to both sides
            mean, spread = self.delay + 0.5 * self.jitter, 0.5 * self.jitter
            arguments += ["delay", f"{mean * 1e3:g}ms", f"{spread * 1e3:g}ms"]
        return arguments


class FaultyBus:
    """A bus in virtual time on which `spec` happens.

    Args:
        spec: What goes wrong.
        catalogue: The messages in the protection in use; needed to protect a frame afresh.
        name: Two buses with the same specification and different names draw different random numbers.
    """

    def __init__(self, spec: FaultSpec, catalogue: Catalogue | None = None, name: str = ""):
        self.spec = spec
        self._messages: dict[int, BusMessage] = {
            message.frame_id: message for message in (catalogue or messages()).values()
        }
        self._draws = {f.name: Random(f"{spec.seed} {f.name}{name}") for f in fields(spec)}
        self._under_way: list[tuple[float, int, Frame]] = []
        self._sent = 0
        self._to_lose = 0
        self._offsets: dict[int, int] = {}
        self._last: dict[int, bytes] = {}

    def send(self, time: float, frame_id: int, data: bytes) -> None:
        """Send a frame at `time`, in [s]."""
        spec, message = self.spec, self._messages.get(frame_id)
        if message is None or (spec.only and message.name != spec.only) or not spec.start <= time < spec.end:
            self._last[frame_id] = data
            self._arrive(time, frame_id, self._renumbered(message, data) if message else data)
            return
        for _ in range(spec.flood):
            draw = self._draws["flood"]
            self._arrive(time, draw.randrange(_FOREIGN_IDS), draw.randbytes(8))
        data = self._on_the_wire(self._at_the_sender(message, data))
        copies = 0 if self._is_lost() else 1 + self._happens("duplication")
        for copy in range(2):  # drawn for both whatever happens, see `FaultSpec`
            late = REORDER_DELAY * self._happens("reorder") + spec.jitter * self._draws["jitter"].random()
            if copy < copies:
                self._arrive(time + spec.delay + late, frame_id, data)

    def receive(self, time: float) -> list[Frame]:
        """Frames that have arrived until `time`, in [s], in the order of their arrival."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= time + 1e-9:
            arrived.append(heappop(self._under_way)[2])
        return arrived

    def _happens(self, name: str) -> bool:
        return self._draws[name].random() < getattr(self.spec, name)

    def _arrive(self, time: float, frame_id: int, data: bytes) -> None:
        self._sent += 1  # frames of the same instant keep their order
        heappush(self._under_way, (time, self._sent, (frame_id, data)))

    def _is_lost(self) -> bool:
        if not self._to_lose and self._happens("loss"):
            self._to_lose = self._draws["burst"].randint(1, self.spec.burst)
        lost = self._to_lose > 0
        self._to_lose -= lost
        return lost

    def _at_the_sender(self, message: BusMessage, data: bytes) -> bytes:
        """Faults of the sender: what it sends is intact, but not what it should be."""
        past = self._last.setdefault(message.frame_id, data)
        if self.spec.freeze:
            return self._renumbered(message, past)
        if self.spec.stuck:
            data = _protect(message, past, message.profile.counter_of(data) or 0)
        self._last[message.frame_id] = data
        if self._happens("counter_jump"):
            jump = self._draws["counter_jump"].randrange(1, max(2, message.profile.counters))
            self._offsets[message.frame_id] = self._offsets.get(message.frame_id, 0) + jump
        data = self._renumbered(message, data)
        if self._happens("masquerade"):
            others = [other for other in self._messages.values() if other is not message]
            data = _protect(self._draws["masquerade"].choice(others), data, message.profile.counter_of(data) or 0)
        return data

    def _on_the_wire(self, data: bytes) -> bytes:
        """Faults of the wire: what arrives is not what was sent."""
        if self._happens("corruption"):
            flips = self._draws["corruption"].getrandbits(8 * len(data)) or 1
            data = (int.from_bytes(data, "big") ^ flips).to_bytes(len(data), "big")
        if self._happens("wrong_length"):
            data = data[: self._draws["wrong_length"].randrange(len(data))]
        return data

    def _renumbered(self, message: BusMessage, data: bytes) -> bytes:
        offset, counter = self._offsets.get(message.frame_id, 0), message.profile.counter_of(data)
        return _protect(message, data, counter + offset) if offset and counter is not None else data


def _protect(message: BusMessage, data: bytes, counter: int) -> bytes:
    """The payload of `data` under a fresh header."""
    fresh = bytearray(data)
    message.profile.protect(fresh, counter % message.profile.counters)
    return bytes(fresh)


def _percent(name: str, share: float) -> list[str]:
    return [name, f"{100.0 * share:g}%"] if share else []
