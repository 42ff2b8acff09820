"""What an archive may hold: seen in its list of contents, before anything in it is unpacked."""

import zipfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from sidestep.plant_models.errors import InputError

MOST_ENTRIES, MOST_BYTES, MOST_RATIO, MOST_DEPTH = 20_000, 2 << 30, 200, 32
"""Files, bytes when unpacked, bytes unpacked for each one packed, folders in each other."""

SMALL = 64 << 20
"""Bytes that any archive may unpack to, however well they were packed."""

_MOST_LETTERS = 1000  # of a path
_PACKING = {zipfile.ZIP_STORED: "stored", zipfile.ZIP_DEFLATED: "deflated"}
_ENCRYPTED = 1


def require_sound(path: Path, entries: Sequence[zipfile.ZipInfo]) -> None:
    """Refuse an archive that would write elsewhere, take the disk or the memory, or cannot be unpacked.

    Sizes are what the archive says: zipfile unpacks no more of a file than that.

    Raises:
        InputError: With what it is.
    """
    if len(entries) > MOST_ENTRIES:
        raise InputError(str(path), f"{len(entries)} files in it", f"up to {MOST_ENTRIES}")
    seen: set[str] = set()
    for entry in entries:
        if problem := _problem(entry.filename) or _packing(entry):
            raise InputError(str(path), problem)
        if entry.filename in seen:
            raise InputError(str(path), f"two files {entry.filename!r} in the archive: refused")
        seen.add(entry.filename)
    size, packed = sum(entry.file_size for entry in entries), path.stat().st_size
    if size > MOST_BYTES:
        raise InputError(str(path), f"it unpacks to {size} bytes", f"up to {MOST_BYTES}")
    if size > SMALL and size > MOST_RATIO * packed:
        allowed = f"up to {MOST_RATIO} times its {packed}, or {SMALL}"
        raise InputError(str(path), f"it unpacks to {size} bytes", allowed)


def _problem(name: str) -> str:
    """What is wrong with a path in the archive; empty if nothing is."""
    parts = PurePosixPath(name).parts
    if name.startswith("/") or "\\" in name or ":" in name or ".." in parts:
        return f"unsafe path {name[:100]!r} in the archive: refused"
    if not name.strip("./") or any(letter < " " for letter in name):
        return f"a path {name[:100]!r} in the archive that is no name: refused"
    if len(parts) > MOST_DEPTH or len(name) > _MOST_LETTERS:
        return f"a path of {len(parts)} folders and {len(name)} letters in the archive: refused"
    return ""


def _packing(entry: zipfile.ZipInfo) -> str:
    if entry.flag_bits & _ENCRYPTED:
        return f"{entry.filename!r} in it is encrypted"
    if entry.compress_type not in _PACKING:
        return f"{entry.filename!r} in it is packed by method {entry.compress_type}; allowed: deflated, stored"
    return ""
