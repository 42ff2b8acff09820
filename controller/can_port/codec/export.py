"""steer.dbc in other formats, and as a page to read."""

import json
from typing import Any

from cantools.database.can import Message, Signal

from sidestep.controller.can_port.codec.database import Protection, load_dbc

FORMATS = ("dbc", "kcd", "sym", "json")


def exported(kind: str, protection: Protection = "P02") -> str:
    """The database as text.

    Args:
        kind: One of `FORMATS`.
        protection: End-to-end protection that it describes.
    """
    database = load_dbc(protection)
    if kind == "json":
        return json.dumps({"messages": [_message(message) for message in database.messages]}, indent=2) + "\n"
    text = {"dbc": database.as_dbc_string, "kcd": database.as_kcd_string, "sym": database.as_sym_string}[kind]()
    return text.replace("\r\n", "\n").rstrip("\n") + "\n"


def page() -> str:
    """docs/can_messages.md."""
    database = load_dbc()
    head = (
        "# The messages of steer.dbc\n\nMade by `python tools/pages.py`; a test holds it "
        "against the database. 500 kbit/s, standard\nidentifiers, little-endian, SI units, radians, ISO 8855 axes. "
        "Start values are the safe ones: what a frame carries\nwhen a number in it is not finite.\n"
    )
    return head + "".join(_section(message) for message in database.messages)


def _section(message: Message) -> str:
    signals = "".join(_row(signal) for signal in message.signals)
    return (
        f"\n## {message.name} (0x{message.frame_id:03X})\n\n{message.comment}. {message.length} bytes, every "
        f"{message.cycle_time} ms, from {', '.join(message.senders)}.\n\n"
        "| signal | bits | step | range | unit | start | meaning |\n|---|---|---|---|---|---|---|\n" + signals
    )


def _row(signal: Signal) -> str:
    names = ", ".join(f"{number} {name}" for number, name in (signal.choices or {}).items())
    meaning = "; ".join(words for words in (signal.comment, names) if words)
    last = signal.start + signal.length - 1
    bits = f"{signal.start}" if signal.length == 1 else f"{signal.start}-{last}{' signed' if signal.is_signed else ''}"
    kind = "any" if signal.minimum is None else f"{signal.minimum:g} to {signal.maximum:g}"
    return (
        f"| {signal.name} | {bits} | {'double' if signal.is_float else f'{signal.scale:g}'} | {kind} | "
        f"{signal.unit or ''} | {signal.raw_initial or 0} | {meaning} |\n"
    )


def _message(message: Message) -> dict[str, Any]:
    assert message.dbc is not None
    return {
        "name": message.name, "id": message.frame_id, "length": message.length, "cycle_ms": message.cycle_time,
        "fd": message.is_fd, "senders": message.senders, "comment": message.comment,
        "attributes": {name: attribute.value for name, attribute in message.dbc.attributes.items()},
        "signals": [_signal(signal) for signal in message.signals],
    }  # fmt: skip


def _signal(signal: Signal) -> dict[str, Any]:
    return {
        "name": signal.name, "start": signal.start, "length": signal.length, "signed": signal.is_signed,
        "byte_order": signal.byte_order, "scale": signal.scale, "offset": signal.offset,
        "minimum": signal.minimum, "maximum": signal.maximum, "unit": signal.unit, "start_value": signal.raw_initial,
        "choices": {int(number): str(name) for number, name in (signal.choices or {}).items()},
        "comment": signal.comment, "receivers": signal.receivers,
    }  # fmt: skip
