"""What several commands' options share: numbers that are refused before anything runs, and `--jobs`."""

import argparse
import math
from collections.abc import Callable


def whole_number(text: str) -> int:
    """A whole number above 0.

    Raises:
        ArgumentTypeError: It is none.
    """
    if not (text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number > 0")
    return int(text)


def seed(text: str) -> int:
    """A whole number from 0 on.

    Raises:
        ArgumentTypeError: It is none.
    """
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number >= 0")
    return int(text)


def positive_number(text: str) -> float:
    """A finite number above 0.

    Raises:
        ArgumentTypeError: It is none.
    """
    return _number(text, lambda value: 0.0 < value < math.inf, "> 0")


def share(text: str) -> float:
    """A number from 0 to 1.

    Raises:
        ArgumentTypeError: It is none.
    """
    return _number(text, lambda value: 0.0 <= value <= 1.0, "from 0 to 1")


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add `--jobs`; -1, joblib's word for one process per core, is the default."""
    parser.add_argument("--jobs", type=whole_number, default=-1, metavar="J", help="processes; default: one per core")


def _number(text: str, fits: Callable[[float], bool], allowed: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not fits(value):
        raise argparse.ArgumentTypeError(f"{text!r} is no number {allowed}")
    return value
