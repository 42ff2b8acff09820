"""Packed files from outside, unpacked piece by piece and only so far."""

import gzip
import zlib
from pathlib import Path

from sidestep.plant_models.errors import InputError

MOST_BYTES = 4 << 30
"""Of a packed file, when unpacked."""

_PIECE = 1 << 20


def unpack_gz(packed: Path, target: Path) -> None:
    """Unpack a .gz to a new file.

    Raises:
        InputError: It is none, is damaged, or holds more than MOST_BYTES.
    """
    written = 0
    try:
        with gzip.open(packed) as source, target.open("xb") as file:
            while piece := source.read(_PIECE):
                written += file.write(piece)
                if written > MOST_BYTES:
                    raise InputError(str(packed), f"unpacks to more than {MOST_BYTES} bytes", "a smaller file")
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(str(packed), f"cannot be unpacked ({error})", "a .gz") from error
