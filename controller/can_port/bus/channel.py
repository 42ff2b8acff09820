"""Receiving end of one message: frame check and state machine together decide what may be used."""

from collections.abc import Iterable

from sidestep.controller.can_port.codec.database import CYCLE, BusMessage
from sidestep.controller.can_port.protection.e2e import ACCEPTED, Receiver
from sidestep.controller.can_port.protection.e2e_state import E2EState, E2EStateMachine

Data = bytes | bytearray


class Channel:
    """Receiving end of one message.

    Args:
        message: The message in the protection in use.

    Attributes:
        message: The same.
        receiver: Check of every frame, with its counts.
        machine: State machine over the checks.
    """

    def __init__(self, message: BusMessage):
        self.message = message
        self.receiver = Receiver(message.profile, message.length)
        self.machine = E2EStateMachine()
        self._cycles_per_frame = max(1, round(message.cycle / CYCLE))
        self._missed = 0

    @property
    def state(self) -> E2EState:
        """State of the channel."""
        return self.machine.state

    def accept(self, data: Data | None) -> bool:
        """Check one frame, or None for a cycle without one; whether its data may be used.

        It may if the check says OK or OKSOMELOST, the channel is VALID and the reserved bits are 0.
        """
        self._missed = 0
        status = self.receiver.check(data)
        valid = self.machine.add(status) is E2EState.VALID and status in ACCEPTED
        return valid and data is not None and not int.from_bytes(data, "little") & self.message.reserved

    def take(self, frames: Iterable[Data]) -> list[Data]:
        """Check what arrived in one cycle, oldest first; what of it may be used."""
        arrived = list(frames)
        if not arrived:
            self.miss()
        return [data for data in arrived if self.accept(data)]

    def miss(self) -> None:
        """Nothing arrived in this cycle of the node; counts where the message was due."""
        self._missed += 1
        if self._missed >= self._cycles_per_frame:
            self.accept(None)
