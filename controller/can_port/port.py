"""The steering port: commands go out as frames, what comes off the bus is what the plant gets."""

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from math import isnan, nan
from pathlib import Path
from time import monotonic
from typing import Self

import can

from sidestep.controller.can_port.bus.bus import Bus, key_of, resolve_spec
from sidestep.controller.can_port.bus.log import open_log
from sidestep.controller.can_port.codec.database import CYCLE, EXTENDED, BusMessage
from sidestep.controller.can_port.codec.messages import (
    MAX_RATE_LIMIT,
    STEER_CMD,
    decode_drive_command,
    decode_steer_command,
    drive_message,
    encode_drive_command,
    encode_steer_command,
)
from sidestep.controller.can_port.codec.samples import exact_frame, sample_number
from sidestep.controller.can_port.findings import Finding, Verdict
from sidestep.controller.can_port.protection.e2e import ACCEPTED, CheckStatus, Receiver
from sidestep.plant_models.signals import SteeringCommand, VehicleState

HELD = 0.05
"""How long the last command may be held, as an actuator on the bus would hold it, in [s]."""

_OWN = 64  # frames that are known again when they come back
_PATIENCE = 0.1  # longest wait for our own frame to cross the bus, in [s]
_USABLE = ACCEPTED | {CheckStatus.INITIAL}


class SteeringPort:
    """Sender and receiver of the steering command in one process, in simulation time.

    What it hands back is the bus's echo of what it sent, never a short cut. The state that a command answers does not
    travel here; `announce` puts it into the log in full, so that the log tells what was asked.

    `transmit` is to be called every `CYCLE` seconds of simulation time.

    Args:
        spec: Bus, one of `bus.SPECS`; "off" hands every command through.
        log: File for every frame that was received, stamped with simulation time; None for none.
        rate_limit: Steering rate limit to send along, in [rad/s].
        allow_real_bus: Whether the bus may reach hardware.
        message: The message that steers; None for STEER_CMD in Profile 2.
        behind: How many announced states a command lies behind the newest.

    Attributes:
        interface: The bus in use as INTERFACE:CHANNEL, or "off".
        sent: Commands that the bus took.
        lost: Commands that were not taken or did not arrive intact.
        receiver: Check of the received command, with its counts.
        longest_gap: Most commands lost in a row.
        strangers: Frames under the command's identifier that are none of ours.

    Raises:
        InputError: The bus or the log cannot be opened.
    """

    def __init__(
        self,
        spec: str = "auto",
        log: Path | None = None,
        rate_limit: float = MAX_RATE_LIMIT,
        allow_real_bus: bool = False,
        message: BusMessage | None = None,
        behind: int = 0,
    ):
        self.interface = resolve_spec(spec)
        self.sent = self.lost = self.longest_gap = self.strangers = self._gap = 0
        self._beside = SteeringCommand(0.0, 0.0, 0.0)
        self._acceleration = nan  # of the DRIVE_CMD of this call; NaN until it has come
        self._behind, self._announced = behind, deque[int](maxlen=behind + 1)
        self._own: deque[bytes] = deque(maxlen=_OWN)
        self._steer_cmd = STEER_CMD if message is None else message
        self.receiver = Receiver(self._steer_cmd.profile, self._steer_cmd.length)
        self._drive_cmd = drive_message(self._steer_cmd)
        if self._drive_cmd:
            self._drive_message = _message(self._drive_cmd)
            self._drive_receiver = Receiver(self._drive_cmd.profile, self._drive_cmd.length)
        self._rate_limit = rate_limit
        self._counter = 0
        self._held: SteeringCommand | None = None
        frame = self._message = _message(self._steer_cmd)
        self._record: Callable[[can.Message], None] | None = None
        with ExitStack() as resources:
            if self.interface != "off":
                self._bus = resources.enter_context(
                    Bus(self.interface, (), True, frame.is_fd, allow_real_bus, everything=frame.is_extended_id)
                )
                if log is not None:
                    self._record = resources.enter_context(open_log(log)).on_message_received
            self._resources = resources.pop_all()

    def transmit(self, command: SteeringCommand) -> SteeringCommand | None:
        """Send a command over the bus and return what the plant has to apply.

        Returns:
            The command as decoded at the far end; the last one if nothing usable arrived; None before the first.
        """
        if self.interface == "off":
            return command
        answers = self._announced[0] if len(self._announced) > self._behind else None
        if self._drive_cmd:
            self._acceleration = nan
            self._send(self._drive_message, encode_drive_command(command, self._counter, True, self._drive_cmd))
        data = encode_steer_command(command, self._counter, True, self._rate_limit, self._steer_cmd, answers)
        self._counter += 1
        self._beside = command  # speed and acceleration go beside the bus if the message has no place for a speed
        taken = self._send(self._message, data)
        self.sent += taken
        arrived = self._receive(command.time, data if taken else None)
        self.lost, self._gap = self.lost + (not arrived), 0 if arrived else self._gap + 1
        self.longest_gap = max(self.longest_gap, self._gap)
        return self._held

    def announce(self, state: VehicleState) -> None:
        """The state that the controller is given now: for the log, and for the commands to name."""
        self._announced.append(sample_number(state.time))
        if self._record:
            self._record(exact_frame(state))

    def findings(self) -> tuple[Finding, ...]:
        """What a verdict has to name."""
        found: tuple[tuple[bool, str, Verdict, str], ...] = (
            (self.strangers > 0, "second sender", "inconclusive",
             f"{self.strangers} commands from elsewhere on {self.interface}"),
            (self.longest_gap * CYCLE > HELD, "commands lost", "fail",
             f"{self.lost} commands lost, {self.longest_gap} in a row"),
            (self.lost > 0, "commands bridged", "pass", f"{self.lost} commands lost, the last one held"),
        )  # fmt: skip
        return tuple(Finding(label, verdict, text) for there, label, verdict, text in found if there)

    def close(self) -> None:
        """Complete the log and leave the bus; a second call does no harm."""
        self._resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _send(self, message: can.Message, data: bytes) -> bool:
        # bytes, not bytearray: the virtual bus deep-copies the frame, and bytes cost nothing to copy
        message.data = data  # pyright: ignore[reportAttributeAccessIssue]
        self._own.append(data)
        return self._bus.send(message)

    def _receive(self, time: float, expected: bytes | None) -> bool:
        """Take in what waits, or comes in time, up to the expected frame; whether that one was accepted."""
        deadline = 0.0 if expected is None else monotonic() + _PATIENCE
        while message := self._bus.receive(max(0.0, deadline - monotonic()) if deadline else 0.0):
            usable = self._accept(message, time)
            if message.data == expected:
                return usable
        return False

    def _accept(self, message: can.Message, time: float) -> bool:
        if self._record:
            message.timestamp, message.channel = time, 0
            self._record(message)
        if self._drive_cmd and key_of(message) == self._drive_cmd.frame_id:
            self._accept_drive(message, self._drive_cmd)
        if key_of(message) != self._steer_cmd.frame_id:
            return False
        self.strangers += bytes(message.data) not in self._own
        if self.receiver.check(message.data) not in _USABLE:
            return False
        held = decode_steer_command(message.data, time, self._steer_cmd).command
        if self._drive_cmd:
            held = replace(held, acceleration=self._acceleration)
        elif isnan(held.target_speed):
            given = self._beside.acceleration if isnan(held.acceleration) else held.acceleration
            held = replace(held, target_speed=self._beside.target_speed, acceleration=given)
        self._held = held
        return True

    def _accept_drive(self, message: can.Message, drive: BusMessage) -> None:
        self.strangers += bytes(message.data) not in self._own
        if self._drive_receiver.check(message.data) in _USABLE:
            self._acceleration = decode_drive_command(message.data, drive)


def _message(kind: BusMessage) -> can.Message:
    return can.Message(
        arbitration_id=kind.frame_id & ~EXTENDED,
        dlc=kind.length,
        is_extended_id=bool(kind.frame_id & EXTENDED),
        is_fd=kind.is_fd,
    )
