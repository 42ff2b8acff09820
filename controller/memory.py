"""What a controller keeps from step to step, as bytes: one record under a header that says what it is."""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.records import MEMORY, record
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status

VERSION = 1
"""Of the record; rises with every change of `MEMORY`."""
_HEADER = struct.Struct("<8sIIQ")  # name, version, checksum, size
_NAME = b"sidestep"


def empty(cruise: float) -> NDArray[np.void]:
    """The memory before the first step; `cruise` is the speed to go back to, NaN for that of the first state."""
    memory = record(MEMORY)
    memory["heard"], memory["station"], memory["before_time"] = -np.inf, np.nan, np.nan
    memory["command"]["status"] = Status.FAULT
    memory["cruise"], memory["last"], memory["good"] = cruise, -1, -1
    return memory


def saved(memory: NDArray[np.void]) -> bytes:
    """The record's bytes under a header with version, checksum and size."""
    data = memory.tobytes()
    return _HEADER.pack(_NAME, VERSION, zlib.crc32(data), len(data)) + data


def restored(data: bytes) -> NDArray[np.void]:
    """The record that `saved` made bytes of.

    Raises:
        InputError: The bytes are of something else, of another version, or damaged.
    """
    allowed = f"{_HEADER.size + MEMORY.itemsize} bytes of version {VERSION}, as `save` gives them"
    if len(data) < _HEADER.size:
        raise InputError("memory", f"{len(data)} bytes", allowed)
    name, version, checksum, size = _HEADER.unpack_from(data)
    body = data[_HEADER.size :]
    if name != _NAME or version != VERSION:
        raise InputError("memory", f"of {name!r}, version {version}", allowed)
    if size != MEMORY.itemsize or len(body) != size:
        raise InputError("memory", f"{len(data)} bytes", allowed)
    if zlib.crc32(body) != checksum:
        raise InputError("memory", "the checksum is wrong: the bytes are damaged", allowed)
    memory = record(MEMORY)
    memory[:] = np.frombuffer(body, MEMORY)
    return memory
