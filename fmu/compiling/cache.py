"""The cache of what was built: entries that are whole, or built again.

An entry's name ends with a digest of its contents, which is compared on every use: a file that was cut short, or holds
something else, is removed. Entries are written beside their place, forced to the disk and renamed.
"""

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.fresh_file import beside


def cached(name: str, suffix: str, build: Callable[[], bytes]) -> Path:
    """The entry of this name, built if it is not there or not whole.

    Args:
        name: Says what is in it: the same name, the same contents.
        suffix: Of the file, with its dot.
        build: Makes the contents.

    Raises:
        InputError: The cache cannot be written.
    """
    folder = cache_folder()
    for file in folder.glob(f"{name}-*{suffix}"):
        with suppress(OSError):
            if file.name == _file_name(name, suffix, file.read_bytes()):
                return file
            file.unlink()
    data = build()
    file = folder / _file_name(name, suffix, data)
    write_whole(file, data)
    return file


def cache_folder() -> Path:
    """Where entries are; made if need be.

    Raises:
        InputError: It cannot be made or written.
    """
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base, "sidestep")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("XDG_CACHE_HOME", f"{folder} cannot be made: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise InputError("XDG_CACHE_HOME", f"{folder} cannot be written")
    return folder


def write_whole(file: Path, data: bytes) -> None:
    """Write in one go: whoever looks, even after the power failed, sees no file or the whole file."""
    fresh = beside(file)
    try:
        with fresh.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        fresh.replace(file)
        _sync_folder(file.parent)
    finally:
        fresh.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    with suppress(OSError):  # not every system opens folders
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _file_name(name: str, suffix: str, data: bytes) -> str:
    return f"{name}-{hashlib.sha256(data).hexdigest()[:16]}{suffix}"
