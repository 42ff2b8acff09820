"""The command line's parser: one line for an error, with what may have been meant, and an example under every help."""

import argparse
import re
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

from sidestep.validation.cli.shell.examples import EXAMPLES
from sidestep.validation.cli.shell.last_resort import one_line

BAD_INPUT = 2


class Parser(argparse.ArgumentParser):
    """Of the program, and of each of its commands."""

    def __init__(self, **settings: Any):
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **settings)
        if example := EXAMPLES.get(self.prog):
            self.epilog = f"example:\n  {example}"

    def error(self, message: str) -> NoReturn:
        """Leave with one line on stderr."""
        self.exit(BAD_INPUT, f"sidestep: {one_line(message)}{self._meant(message)} (see {self.prog} --help)\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """As argparse does, but what a command does not know is refused by that command, which knows what it does."""
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return parsed, unknown

    def _meant(self, message: str) -> str:
        """The option or command next to what was typed, if any is near."""
        if typed := re.match(r"unrecognized arguments: .*?(--?[\w-]+)", message):
            near = get_close_matches(typed[1], options_of(self), 1)
        elif typed := re.match(r"argument (?:COMMAND|\w+): invalid choice: '(.*?)' ", message):
            near = get_close_matches(typed[1], dict(commands_of(self)), 1)
        else:
            near = []
        return f"; did you mean {near[0]}?" if near else ""


def options_of(parser: argparse.ArgumentParser) -> list[str]:
    """The options that a command takes, in their order."""
    return [option for action in parser._actions for option in action.option_strings]


def commands_of(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The commands below a parser by their names."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from action.choices.items()


def every_command(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """A parser and all below it."""
    yield parser
    for _, below in commands_of(parser):
        yield from every_command(below)


def words_of(parser: argparse.ArgumentParser) -> Iterable[tuple[str, str]]:
    """What may follow a command, each with its help: commands below it and options."""
    yield from ((name, below.description or _help_of(parser, name)) for name, below in commands_of(parser))
    yield from ((option, _text(action)) for action in parser._actions for option in action.option_strings)


def choices_of(parser: argparse.ArgumentParser) -> dict[str, Sequence[str]]:
    """The values of those options that have a list of them."""
    return {
        option: [str(choice) for choice in action.choices]
        for action in parser._actions
        if action.choices and action.option_strings
        for option in action.option_strings
    }


def _help_of(parser: argparse.ArgumentParser, name: str) -> str:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for choice in action._choices_actions:
                if choice.dest == name:
                    return choice.help or ""
    return ""


def _text(action: argparse.Action) -> str:
    return (action.help or "").partition(";")[0].replace("%(default)s", str(action.default))
