"""Opening and using a CAN bus: a thin, careful wrapper around python-can.

Meant for virtual buses: one process (`virtual`), several on one machine (`udp_multicast`), Linux vcan (`socketcan`).
"""

import ipaddress
import os
import socket
from collections import deque
from collections.abc import Iterable
from itertools import count
from pathlib import Path
from time import monotonic
from typing import Any, Self

import can

from sidestep.controller.can_port.codec.database import EXTENDED, Frame
from sidestep.plant_models.errors import InputError

SPECS = "auto, off, virtual:NAME, udp_multicast:GROUP:PORT, socketcan:vcan0"
"""What `--can` takes."""

_RECEIVE_BUFFER = 4 << 20  # the default holds about 270 frames, the rest vanishes silently
_SO_RCVBUFFORCE = 33
_IP_MULTICAST_ALL = 49
_ARPHRD_CAN = "280"
_GROUP = "239.74.163.2"  # administratively scoped, python-can's default
_FIRST_PORT = 43200
_ECHOES = 64  # own frames that are remembered until they come back
_BAD_FRAMES = 1000  # one call gives up after so many unreadable frames in a row
_virtual_channels = count(1)


class Bus:
    """An open CAN bus. Nothing but a wrong specification makes it raise.

    Args:
        spec: INTERFACE:CHANNEL, as `resolve_spec` returns it.
        own_ids: Identifiers that only this end sends.
        echo: Whether the bus hands back what is sent here.
        fd: Whether CAN FD frames are to pass.
        allow_real_bus: Whether the bus may reach hardware.
        everything: Whether frames of every kind are handed out: error, remote, extended, and others' under `own_ids`.

    Attributes:
        spec: The specification.
        errors: Frames that could not be sent or read.
        strangers: Frames that others sent under `own_ids`.
        error_frames: What the bus itself reported.

    Raises:
        InputError: The bus cannot be opened, or is not virtual and `allow_real_bus` is False.
    """

    def __init__(
        self,
        spec: str,
        own_ids: Iterable[int] = (),
        echo: bool = False,
        fd: bool = False,
        allow_real_bus: bool = False,
        everything: bool = False,
    ):
        self.spec, self._own_ids, self._everything = spec, frozenset(own_ids), everything
        self.errors = self.strangers = self.error_frames = 0
        self._echoes: deque[Frame] = deque(maxlen=_ECHOES)  # sent, and still to come back
        arguments = _bus_arguments(spec, allow_real_bus)
        self._always_echoes = arguments["interface"] == "udp_multicast"
        if not self._always_echoes:
            arguments["receive_own_messages"] = echo
        if arguments["interface"] != "virtual":
            arguments["fd"] = fd
        try:
            self._bus = can.Bus(ignore_config=True, **arguments)
        except (can.CanError, OSError, ValueError, ImportError) as error:
            raise InputError("can", f"cannot open {spec!r}: {error}", SPECS) from error
        if arguments["interface"] in ("socketcan", "udp_multicast"):
            _set_socket_options(self._bus.fileno(), arguments["interface"])

    def send(self, message: can.Message) -> bool:
        """Send a frame; False if the bus did not take it (queue full, interface down)."""
        try:
            self._bus.send(message, timeout=0.0)
        except (can.CanError, OSError):
            self.errors += 1
            return False
        if self._always_echoes and (key := key_of(message)) in self._own_ids:
            self._echoes.append((key, bytes(message.data)))
        return True

    def receive(self, timeout: float = 0.0) -> can.Message | None:
        """The next frame that is not our own; None if none arrives within `timeout` seconds."""
        deadline = monotonic() + timeout if timeout > 0.0 else 0.0
        for _ in range(_BAD_FRAMES):
            try:
                message = self._bus.recv(timeout)
            except (can.CanError, OSError):  # garbage datagram, interface gone down
                self.errors += 1
            else:
                if message is None or self._is_wanted(message):
                    return message
            if timeout > 0.0:
                timeout = max(0.0, deadline - monotonic())
        return None

    def drain(self) -> list[can.Message]:
        """All frames that have arrived, oldest first; never waits."""
        return list(iter(self.receive, None))

    def close(self) -> None:
        """Leave the bus; a second call does no harm."""
        self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def is_ours(self, message: can.Message) -> bool:
        """Whether it is a data frame that others send; with an extended identifier only if everything is wanted."""
        return not (
            message.is_error_frame
            or message.is_remote_frame
            or (message.is_extended_id and not self._everything)
            or key_of(message) in self._own_ids
        )

    def _is_wanted(self, message: can.Message) -> bool:
        if message.is_error_frame:
            self.error_frames += 1
        elif (key := key_of(message)) in self._own_ids:
            sent = (key, bytes(message.data))
            if sent in self._echoes:
                self._echoes.remove(sent)
                return False
            self.strangers += 1
        return self._everything or self.is_ours(message)


def key_of(message: can.Message) -> int:
    """Identifier of a frame, `EXTENDED` added to one of 29 bits."""
    return message.arbitration_id | EXTENDED * message.is_extended_id


def resolve_spec(spec: str, several_processes: bool = False) -> str:
    """The bus that `spec` means here and now, as INTERFACE:CHANNEL or "off".

    Args:
        spec: One of `SPECS`. "auto" is socketcan:vcan0 if there is one, else a virtual channel that nobody else uses,
            or, for several processes, a udp_multicast port that belongs to this user.
        several_processes: Whether the bus has to reach other processes.
    """
    if spec != "auto":
        return spec
    if "vcan0" in can_interfaces():
        return "socketcan:vcan0"
    if several_processes:
        return f"udp_multicast:{_GROUP}:{_FIRST_PORT + os.getuid() % 1000}"
    return f"virtual:sidestep-{next(_virtual_channels)}"


def can_interfaces() -> list[str]:
    """Names of the CAN network interfaces of this machine."""
    types = Path("/sys/class/net").glob("*/type")
    return sorted(file.parent.name for file in types if file.read_text().strip() == _ARPHRD_CAN)


def _bus_arguments(spec: str, allow_real_bus: bool) -> dict[str, Any]:
    name, _, channel = spec.partition(":")
    interface = name.lower()
    if interface not in can.VALID_INTERFACES:
        raise InputError("can", f"unknown interface {name!r} in {spec!r}", SPECS)
    if not channel:
        raise InputError("can", f"{spec!r} names no channel", SPECS)
    if interface == "virtual":
        return {"interface": interface, "channel": channel}
    if interface == "udp_multicast":
        return _multicast_arguments(spec, channel)
    if interface == "socketcan" and channel not in can_interfaces():
        there = ", ".join(can_interfaces()) or "none"
        raise InputError("can", f"no CAN interface {channel!r} on this machine (there are: {there})", SPECS)
    if not (allow_real_bus or (interface == "socketcan" and _is_vcan(channel))):
        raise InputError("can", f"{spec!r} may move real hardware", f"{SPECS}, or --allow-real-bus")
    return {"interface": interface, "channel": channel}


def _multicast_arguments(spec: str, channel: str) -> dict[str, Any]:
    group, _, port = channel.rpartition(":")
    group = group.strip("[]")
    try:
        usable = ipaddress.ip_address(group).is_multicast and 0 < int(port) < 65536
    except ValueError:
        usable = False
    if not usable:
        raise InputError("can", f"{spec!r} is no multicast group and port", f"udp_multicast:{_GROUP}:{_FIRST_PORT}")
    # hop limit 0: the frames never leave this machine
    return {"interface": "udp_multicast", "channel": group, "port": int(port), "hop_limit": 0}


def _is_vcan(channel: str) -> bool:
    """By name and by sysfs, so that a renamed real interface does not pass."""
    return channel.startswith(("vcan", "vxcan")) and Path("/sys/devices/virtual/net", channel).exists()


def _set_socket_options(descriptor: int, interface: str) -> None:
    with socket.socket(fileno=os.dup(descriptor)) as sock:
        try:
            sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER)
        except PermissionError:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        if interface == "udp_multicast" and sock.family == socket.AF_INET:
            sock.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)  # else other groups on this port are heard too
