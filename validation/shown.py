"""The command's two streams: there even if they were closed, and free of what a terminal would obey."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from typing import Any, TextIO, cast

from sidestep.plant_models.errors import printable


@contextmanager
def shown() -> Iterator[None]:
    """Let what is printed pass through `printable`: names and texts come from other people's files."""
    before = sys.stdout, sys.stderr
    _open_closed()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without our units and dashes is no reason to end
    sys.stdout, sys.stderr = (cast(TextIO, _Printable(stream)) for stream in (sys.stdout, sys.stderr))
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def _open_closed() -> None:
    """Give the streams that the process was started without to nobody, before a file of ours gets their number."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 (for as long as the process)


class _Printable:
    """A stream that writes through `printable`; rich, which makes its own escapes, takes the one behind."""

    def __init__(self, stream: TextIO):
        self.rich_proxied_file = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)

    def write(self, text: str) -> int:
        self.rich_proxied_file.write(printable(text))
        return len(text)
