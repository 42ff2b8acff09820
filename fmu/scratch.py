"""Temporary folders that outlive no process, not even one that was killed: the next one sweeps up.

A folder's owner holds a lock on a file in it. The system lets go of the lock when the owner dies, however it dies; a
folder whose lock can be had is nobody's.
"""

import os
import re
import shutil
import tempfile
import time
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: nothing is swept there
    fcntl = None

_LOCK, _PREFIX = ".sidestep-lock", "sidestep-"
_NAME = re.compile(r"sidestep-(fmu|build|process)-\w+")
_YOUNG = 600.0  # seconds in which a folder may be without its lock: its owner is about to make it
_locks: dict[Path, int] = {}


def scratch_folder(purpose: str, parent: Path | None = None) -> Path:
    """A new folder, to be given to `discard`; those that dead processes left beside it are removed.

    Args:
        purpose: fmu, build or process: part of its name.
        parent: Where; the system's place for temporary files if None.
    """
    place = parent or Path(tempfile.gettempdir())
    _sweep(place)
    folder = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{purpose}-", dir=place))
    if fcntl:
        _locks[folder] = os.open(folder / _LOCK, os.O_CREAT | os.O_RDWR)
        fcntl.flock(_locks[folder], fcntl.LOCK_EX)
    return folder


def discard(folder: Path) -> None:
    """Remove a scratch folder and all that is in it; a second time does nothing."""
    shutil.rmtree(folder, ignore_errors=True)
    if (lock := _locks.pop(folder, None)) is not None:
        os.close(lock)


def _sweep(place: Path) -> None:
    if not fcntl:
        return
    for folder in place.glob(f"{_PREFIX}*"):
        if _NAME.fullmatch(folder.name) and _is_left_behind(folder):
            shutil.rmtree(folder, ignore_errors=True)


def _is_left_behind(folder: Path) -> bool:
    assert fcntl
    try:
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            return False
        lock = os.open(folder / _LOCK, os.O_RDWR)
    except FileNotFoundError:
        return folder.is_dir() and time.time() - folder.stat().st_mtime > _YOUNG
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(lock)
    return True
