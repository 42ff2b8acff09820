"""Files that are complete or not there, in folders that are made only when all is well."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sidestep.plant_models.errors import InputError


def write_text(file: Path, text: str) -> None:
    """Write a file at once: it is complete or not there."""
    part = file.with_name(f"{file.name}.part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, file)


@contextmanager
def written_to(folder: Path) -> Iterator[None]:
    """Name the folder when something in it cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError("--out", f"cannot write to {str(folder)!r} ({error.strerror})", "a writable folder") from error


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
