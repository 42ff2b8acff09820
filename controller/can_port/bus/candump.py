"""Lines of can-utils' candump -L, every kind of frame as candump writes it."""

from typing import TextIO

import can

_ERROR_FLAG = 0x20000000
_BRS, _ESI = 1, 2


def candump_line(message: can.Message, channel: str | None = None) -> str:
    """The line of a frame, without the line's end.

    Args:
        message: The frame, with its time in [s] since 1970.
        channel: Name of the interface; None takes the message's own.
    """
    seconds, micros = divmod(round(message.timestamp * 1e6), 1_000_000)
    name = channel if channel is not None else message.channel
    return f"({seconds:010d}.{micros:06d}) {name} {_identifier(message)}{_content(message)}"


def _identifier(message: can.Message) -> str:
    if message.is_error_frame:
        return f"{message.arbitration_id & 0x1FFFFFFF | _ERROR_FLAG:08X}"
    return f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"


def _content(message: can.Message) -> str:
    if message.is_fd:
        flags = _BRS * message.bitrate_switch | _ESI * message.error_state_indicator
        return f"##{flags:X}{message.data.hex().upper()}"
    if message.is_remote_frame:
        return f"#R{message.dlc}" if message.dlc else "#R"
    return f"#{message.data.hex().upper()}"


class CandumpWriter:
    """Writes frames as lines.

    Args:
        file: Open for writing.
    """

    def __init__(self, file: TextIO):
        self._file = file

    def on_message_received(self, message: can.Message) -> None:
        """Write a frame."""
        self._file.write(candump_line(message) + "\n")
