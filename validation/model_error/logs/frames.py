"""Channels of a CAN log, decoded by a database."""

from collections import Counter
from pathlib import Path
from typing import Any

import cantools
import numpy as np

from sidestep.controller.can_port.bus.log import read_log
from sidestep.plant_models.errors import InputError
from sidestep.validation.model_error.logs.channel import Channel


def read_frames(file: Path, shown: Path, dbc: Path) -> tuple[dict[str, Channel], list[str]]:
    """Every signal of every frame that the database knows, as SIGNAL where unique and as MESSAGE.SIGNAL.

    Args:
        file: The log.
        shown: Its name for errors.
        dbc: The database.

    Returns:
        Channels, and sentences on frames that could not be decoded.

    Raises:
        InputError: A file cannot be read, or no frame is in the database.
    """
    try:
        database: Any = cantools.database.load_file(dbc, strict=False)
    except Exception as error:  # cantools lets its parsers' errors out
        raise InputError("dbc", f"{str(dbc)!r} cannot be read ({error})", "a CAN database") from error
    messages = {message.frame_id: message for message in database.messages}
    times: dict[str, list[float]] = {}
    values: dict[str, list[float]] = {}
    unknown, broken = Counter[int](), Counter[str]()
    for frame in read_log(file):
        message = messages.get(frame.arbitration_id)
        if message is None:
            unknown[frame.arbitration_id] += 1
            continue
        try:
            decoded = message.decode(frame.data, decode_choices=False)
        except Exception:  # too short, or a multiplexer that is not in the database
            broken[message.name] += 1
            continue
        for signal, value in decoded.items():
            key = f"{message.name}.{signal}"
            times.setdefault(key, []).append(frame.timestamp)
            values.setdefault(key, []).append(float(value))
    if not times:
        raise InputError(str(shown), "no frame of it is in the database", ", ".join(m.name for m in messages.values()))
    units = {f"{m.name}.{s.name}": s.unit or "" for m in messages.values() for s in m.signals}
    channels = {key: Channel(np.array(times[key]), np.array(values[key]), units[key]) for key in times}
    alone = Counter(key.partition(".")[2] for key in channels)
    channels |= {key.partition(".")[2]: c for key, c in channels.items() if alone[key.partition(".")[2]] == 1}
    notes = [f"{count} frames of {name} do not fit the database" for name, count in broken.items()]
    if unknown:
        notes.append(f"{unknown.total()} frames of {len(unknown)} ids are not in the database")
    return channels, notes
