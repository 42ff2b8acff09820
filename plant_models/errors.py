"""The error tree: every error also is a standard-library error and carries its evidence."""

import unicodedata
from collections.abc import Iterable

_UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # control, format (right to left, ...), surrogates, line ends of Unicode


class SidestepError(Exception):
    """Root of everything this project raises on purpose; its text may go to a terminal or into a report."""

    def __str__(self) -> str:
        return printable(super().__str__())


class InputError(SidestepError, ValueError):
    """A value from outside (file, option, argument) that cannot be used.

    Attributes:
        where: File, dotted key, option or argument that holds the value.
        problem: What is wrong with it, the value included.
        allowed: What would be accepted; empty if the problem says so already.
    """

    def __init__(self, where: str, problem: str, allowed: str = ""):
        self.where, self.problem, self.allowed = where, problem, allowed
        super().__init__(f"{where}: {problem}" + (f"; allowed: {allowed}" if allowed else ""))

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, str, str]]:
        """From its parts again, so that it passes from a worker process to the command."""
        return type(self), (self.where, self.problem, self.allowed)


class PlantError(SidestepError, RuntimeError):
    """A plant that cannot go on (solver blew up, FMU returned an error, process died)."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`, did you mean X?` for the closest known word, or nothing."""
    import difflib  # only for who mistyped

    close = difflib.get_close_matches(str(word), list(known), n=1)  # a word that is a number, too
    return f", did you mean {close[0]}?" if close else ""


def printable(text: str) -> str:
    """Text with escapes for what a terminal would obey instead of show; ends of lines and tabs stay."""
    if text.isprintable():
        return text
    return "".join(
        letter.encode("unicode_escape").decode()
        if letter not in "\n\t" and unicodedata.category(letter) in _UNSEEN
        else letter
        for letter in text
    )
