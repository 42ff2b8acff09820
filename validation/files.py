"""Files that are complete or not there, in folders that are made only when all is well."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from sidestep.plant_models.errors import InputError


@contextmanager
def complete(file: Path) -> Iterator[TextIO]:
    """A text file to write to, which takes its name only when all of it is there."""
    part = file.with_name(f"{file.name}.part")
    try:
        with part.open("w", newline="", encoding="utf-8") as stream:
            yield stream
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


def write_text(file: Path, text: str) -> None:
    """Write a file that is complete or not there."""
    with complete(file) as stream:
        stream.write(text)


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


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a folder and see that it takes files; undone if what follows fails."""
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        with written_to(folder):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        yield
    except InputError:
        for path in new:
            with suppress(OSError):
                path.rmdir()
        raise
