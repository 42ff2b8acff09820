"""Files that are complete or not there, in folders that are made only when all is well."""

import errno
import glob
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.fresh_file import beside

_OLD = 3600.0  # seconds


@contextmanager
def complete_path(file: Path) -> Iterator[Path]:
    """A path of the same ending to write to, which becomes `file` when all is there; a device or a pipe is itself."""
    if _is_special(file):
        yield file
        return
    part = beside(file)
    try:
        yield part
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)
        _sweep(file)


@contextmanager
def complete(file: Path) -> Iterator[TextIO]:
    """A text file to write to, complete or not there."""
    with complete_path(file) as path, path.open("w", newline="", encoding="utf-8") as stream:
        yield stream


def write_text(file: Path, text: str) -> None:
    """Write a file that is complete or not there."""
    with complete(file) as stream:
        stream.write(text)


def companion(file: Path, ending: str) -> Path:
    """The file beside another one that belongs to it: `car.toml` has `car` + ending, any other its whole name."""
    return file.with_name(file.name.removesuffix(".toml") + ending)


@contextmanager
def written_to(folder: Path) -> Iterator[None]:
    """Name the folder when something in it cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError("--out", f"cannot write to {str(folder)!r} ({error.strerror})", "a writable folder") from error


@contextmanager
def written_file(file: Path, where: str) -> Iterator[None]:
    """Name the file, and the option or argument `where` that asks for it, when it cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(where, f"cannot write {str(file)!r} ({error.strerror})", "a writable file") from error


def check_file(file: Path | None, where: str) -> None:
    """See that a file can be written, before the work whose end it is; None is one that nobody asked for.

    Raises:
        InputError: It cannot, by the option or argument `where`.
    """
    if file is None:
        return
    with written_file(file, where):
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not _is_special(file):
            tempfile.TemporaryFile(dir=file.absolute().parent).close()


def _sweep(file: Path) -> None:
    """Remove what processes that were killed left of this file: nobody has written to it for an hour."""
    for part in file.parent.glob(f".part-{'?' * 16}-{glob.escape(file.name)}"):
        with suppress(OSError):
            if time.time() - part.lstat().st_mtime > _OLD:
                part.unlink()


def _is_special(file: Path) -> bool:
    return file.exists() and not file.is_file() and not file.is_dir()


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a folder and see that it takes files; undone if what follows fails and has left nothing in it."""
    new: list[Path] = []
    try:
        with written_to(folder):
            new += [path for path in (folder, *folder.parents) if not path.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        yield
    except BaseException:
        for path in new:  # those that are empty
            with suppress(OSError):
                path.rmdir()
        raise
