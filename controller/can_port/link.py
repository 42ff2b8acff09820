"""What a node is connected by: a real bus in real time, or the other node in virtual time."""

import time
from collections.abc import Collection, Iterable
from contextlib import ExitStack
from math import inf
from pathlib import Path
from typing import Any, Protocol, Self

import can

from sidestep.controller.can_port.bus.bus import Bus, key_of
from sidestep.controller.can_port.bus.faults import FaultSpec, FaultyBus
from sidestep.controller.can_port.bus.log import open_log
from sidestep.controller.can_port.bus.pacing import Pacer
from sidestep.controller.can_port.codec.database import CYCLE, EXTENDED, Catalogue, Frame, messages
from sidestep.controller.can_port.nodes import ControllerNode


class Link(Protocol):
    """What a node needs of its bus."""

    def wait(self) -> float:
        """Wait for the next cycle; returns its time, in [s]."""
        ...

    def receive(self) -> list[Frame]:
        """What has arrived since the last call, oldest first."""
        ...

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames now."""
        ...

    def begin(self) -> None:
        """From now on it counts: faults, figures."""
        ...


class RealTimeLink:
    """A bus, one cycle every 10 ms by the clock.

    Args:
        spec: Bus as INTERFACE:CHANNEL.
        senders: Names of this node in the database; what it sends itself is not received.
        catalogue: The messages in use; None for ours in Profile 2.
        log: File for every frame sent and received, stamped with the link's time; None for none.
        allow_real_bus: Whether the bus may reach hardware.
        follows: Whether its deadlines are to lie half a cycle behind the first frame that it hears.

    Attributes:
        pacer: Its deadlines, with statistics.
        sent: Frames that the bus took.
        refused: Frames that it did not take.

    Raises:
        InputError: The bus or the log cannot be opened.
    """

    def __init__(
        self,
        spec: str,
        senders: Collection[str],
        catalogue: Catalogue | None = None,
        log: Path | None = None,
        allow_real_bus: bool = False,
        follows: bool = False,
    ):
        self.pacer = Pacer(CYCLE)
        self._follows = follows
        self.sent = self.refused = 0
        sent = (messages() if catalogue is None else catalogue).values()
        own = [message.frame_id for message in sent if message.sender in senders]
        self._fd = {message.frame_id for message in sent if message.is_fd}
        with ExitStack() as resources:
            self._bus = resources.enter_context(Bus(spec, own, False, bool(self._fd), allow_real_bus, everything=True))
            self._log = resources.enter_context(open_log(log)) if log else None
            self._resources = resources.pop_all()

    def wait(self) -> float:
        """Sleep until the next deadline."""
        return self.pacer.wait()

    def receive(self) -> list[Frame]:
        """Take in every frame that waits."""
        arrived, now, clock = self._bus.drain(), self.pacer.now(), time.time()
        ours = [message for message in arrived if self._bus.is_ours(message)]
        if self._follows and ours:
            self.pacer.follow(now - (clock - ours[0].timestamp))
            self._follows = False
        for message in arrived:  # stamped with when it came, not with when it was taken in
            self._record(message, now - max(0.0, clock - message.timestamp), is_rx=True)
        return [(key_of(message), bytes(message.data)) for message in ours]

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames; those that the bus does not take are counted and gone."""
        now = self.pacer.now()
        for frame_id, data in frames:
            message = can.Message(
                arbitration_id=frame_id & ~EXTENDED,
                data=data,
                is_extended_id=bool(frame_id & EXTENDED),
                is_fd=frame_id in self._fd,
            )
            if self._bus.send(message):
                self.sent += 1
                self._record(message, now, is_rx=False)
            else:
                self.refused += 1

    def begin(self) -> None:
        """Figures count from here."""
        self.pacer.begin()
        self._bus.strangers = self._bus.error_frames = 0

    @property
    def strangers(self) -> int:
        """Frames that came from elsewhere under an identifier of this node."""
        return self._bus.strangers

    def statistics(self, until: float = inf) -> dict[str, Any]:
        """Figures of the bus, and of the deadlines up to `until`, in [s]."""
        bus = {
            "interface": self._bus.spec, "sent": self.sent, "refused": self.refused,
            "strangers": self.strangers, "error_frames": self._bus.error_frames,
        }  # fmt: skip
        return {**bus, **self.pacer.statistics(until)}

    def close(self) -> None:
        """Complete the log and leave the bus; a second call does no harm."""
        self._resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _record(self, message: can.Message, now: float, is_rx: bool) -> None:
        if self._log:
            message.timestamp, message.channel, message.is_rx = max(0.0, now), 0, is_rx
            self._log.on_message_received(message)


class VirtualTimeLink:
    """The controller's node at the other end of a faulty bus, half a cycle apart, in virtual time.

    Args:
        node: The controller's node.
        faults: What goes wrong, in both directions, counted from `begin` on.
        catalogue: The messages in use; None for ours in Profile 2.
    """

    def __init__(self, node: ControllerNode, faults: FaultSpec | None = None, catalogue: Catalogue | None = None):
        self.node, self.time = node, -CYCLE
        self._catalogue, self._faults = messages() if catalogue is None else catalogue, faults or FaultSpec()
        self._to_controller, self._to_vehicle = self._buses(FaultSpec())
        self._zero = 0.0

    def wait(self) -> float:
        """Let half a cycle pass, the controller's node have its turn, and the other half pass."""
        turn = self.time + 0.5 * CYCLE
        for frame_id, data in self.node.step(turn, self._to_controller.receive(turn - self._zero)):
            self._to_vehicle.send(turn - self._zero, frame_id, data)
        self.time += CYCLE
        return self.time

    def receive(self) -> list[Frame]:
        """What has come through to the vehicle."""
        return self._to_vehicle.receive(self.time - self._zero)

    def send(self, frames: Iterable[Frame]) -> None:
        """Send to the controller."""
        for frame_id, data in frames:
            self._to_controller.send(self.time - self._zero, frame_id, data)

    def begin(self) -> None:
        """Faults are counted from here."""
        self._zero = self.time
        self._to_controller, self._to_vehicle = self._buses(self._faults)

    def _buses(self, faults: FaultSpec) -> tuple[FaultyBus, FaultyBus]:
        return FaultyBus(faults, self._catalogue, "up"), FaultyBus(faults, self._catalogue, "down")
