"""What several commands' options share: values that are refused before anything runs, and `--jobs`."""

import argparse
import math
from collections.abc import Callable, Mapping
from typing import Any

from sidestep.plant_models.errors import InputError

PLANTS = "linear, single-track, double-track, mujoco, an .fmu file, a MuJoCo .xml, or MODULE:FACTORY"
"""What `--plant` takes. Not made from the registry of plants: help loads nothing heavy; a test compares the two."""


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


ONE_PER_CORE = -1
"""Joblib's word for as many processes as there are cores."""


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add `--jobs`."""
    parser.add_argument(
        "--jobs", type=whole_number, default=ONE_PER_CORE, metavar="J", help="processes; default: one per core"
    )


def refuse_beside(option: str, others: Mapping[str, Any]) -> None:
    """Refuse options that would be ignored.

    Args:
        option: Beside which they are.
        others: Values by option; None, False, [] and ONE_PER_CORE are those of one that was not given.

    Raises:
        InputError: One was given.
    """
    for other, value in others.items():
        if not (value is None or value is False or value in ([], ONE_PER_CORE)):
            raise InputError(other, f"makes no difference beside {option}", "one of the two")


def _number(text: str, fits: Callable[[float], bool], allowed: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not fits(value):
        raise argparse.ArgumentTypeError(f"{text!r} is no number {allowed}")
    return value


def add_overrides(parser: argparse.ArgumentParser, example: str) -> None:
    """`--set`, with an example, or what it is for."""
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
        help=f"replace a key of the scenario file, {example}; may be repeated",
    )  # fmt: skip
