"""What is said of an error: one line that a terminal can show, and where to report one that nobody foresaw."""

import os
import traceback
from collections.abc import Sequence
from pathlib import Path

from sidestep.plant_models.errors import printable

MOST_LETTERS = 1000
"""Of a line: what is in its middle is left out beyond."""

TRACEBACK = "SIDESTEP_TRACEBACK"
"""Environment variable: print where an unforeseen error comes from, too."""


def one_line(text: str) -> str:
    """Text as one line of at most MOST_LETTERS."""
    line = printable(" ".join(text.split()))
    if len(line) <= MOST_LETTERS:
        return line
    end = MOST_LETTERS // 4
    return f"{line[: MOST_LETTERS - end - 5]} ... {line[-end:]}"


def unforeseen(error: Exception, arguments: Sequence[str]) -> str:
    """The line for an error of ours: what, with which file, and where to report it.

    Args:
        error: It; its traceback is printed if `SIDESTEP_TRACEBACK` is set.
        arguments: Of the command line: those that are files are named.
    """
    if os.environ.get(TRACEBACK):
        traceback.print_exception(error)
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    if isinstance(error, MemoryError):
        return one_line(f"out of memory ({what}), {_files(arguments)}; what was written is kept")
    at = traceback.extract_tb(error.__traceback__)[-1]
    return one_line(
        f"unforeseen {what} ({Path(at.filename).name}:{at.lineno}), {_files(arguments)}; what was written is kept. "
        f"Please report it as CONTRIBUTING.md says, with that input; {TRACEBACK}=1 shows more"
    )


def _files(arguments: Sequence[str]) -> str:
    """The files that a command was given, or the command."""
    given = [value for argument in arguments for value in (argument, argument.partition("=")[2]) if _is_file(value)]
    return f"with {', '.join(map(repr, given))}" if given else f"by {' '.join(arguments)[:200]!r}"


def _is_file(name: str) -> bool:
    try:
        return bool(name) and Path(name).is_file()
    except (OSError, ValueError):
        return False
