"""What is kept from step to step, as bytes: one record under a header that says what it is."""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.records import MEMORY, record
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status

VERSION = 2
"""Of the record; rises with every change of `MEMORY`."""
_HEADER = struct.Struct("<8sIIQ")  # name, version, checksum, size
_NAME = b"sidestep"


def empty(cruise: float) -> NDArray[np.void]:
    """The memory before the first step; `cruise` is the speed to go back to, NaN for that of the first state."""
    memory = record(MEMORY)
    memory["heard"], memory["station"], memory["before_time"] = -np.inf, np.nan, np.nan
    memory["command"]["status"], memory["command"]["acceleration"] = Status.FAULT, np.nan
    memory["cruise"], memory["last"], memory["good"] = cruise, -1, -1
    return memory


def packed(kept: NDArray[np.void], name: bytes, version: int) -> bytes:
    """A record's bytes under a header with name (8 bytes), version, checksum and size."""
    data = kept.tobytes()
    return _HEADER.pack(name, version, zlib.crc32(data), len(data)) + data


def unpacked(data: bytes, dtype: np.dtype, name: bytes, version: int) -> NDArray[np.void]:
    """The record, shape (1,), that `packed` made bytes of.

    Raises:
        InputError: The bytes are of something else, of another version, or damaged.
    """
    allowed = f"{_HEADER.size + dtype.itemsize} bytes of version {version}, as `save` gives them"
    if len(data) < _HEADER.size:
        raise InputError("memory", f"{len(data)} bytes", allowed)
    found, of, checksum, size = _HEADER.unpack_from(data)
    body = data[_HEADER.size :]
    if found != name or of != version:
        raise InputError("memory", f"of {found!r}, version {of}", allowed)
    if size != dtype.itemsize or len(body) != size:
        raise InputError("memory", f"{len(data)} bytes", allowed)
    if zlib.crc32(body) != checksum:
        raise InputError("memory", "the checksum is wrong: the bytes are damaged", allowed)
    kept = record(dtype)
    kept[:] = np.frombuffer(body, dtype)
    return kept


def saved(memory: NDArray[np.void]) -> bytes:
    """The memory's bytes, for `restored`."""
    return packed(memory, _NAME, VERSION)


def restored(data: bytes) -> NDArray[np.void]:
    """The memory that `saved` made bytes of.

    Raises:
        InputError: The bytes are of something else, of another version, or damaged.
    """
    return unpacked(data, MEMORY, _NAME, VERSION)
