"""`sidestep completion`: what the Tab key offers, as a script for a shell, made from the parser itself."""

import argparse
import shlex
from collections.abc import Callable

from sidestep.validation.cli.shell.parser import choices_of, commands_of, every_command, words_of

_SCENARIO = "SCENARIO"


def add_completion(commands: argparse._SubParsersAction, parser: argparse.ArgumentParser) -> None:
    """Add `completion` to the commands of `sidestep`, whose parser is given."""
    completion = commands.add_parser("completion", help="what the Tab key offers: a script for your shell, to stdout")
    completion.add_argument("shell", choices=tuple(_SHELLS))
    completion.set_defaults(command=lambda options: _print(_SHELLS[options.shell](parser)))


def _print(script: str) -> int:
    print(script)
    return 0


def bash(parser: argparse.ArgumentParser) -> str:
    """For bash: words of the command that is reached, values after an option that has a list, and files."""
    return _BASH.format(commands=_commands(parser), words=_cases(parser))


def zsh(parser: argparse.ArgumentParser) -> str:
    """For zsh, the same."""
    return _ZSH.format(commands=_commands(parser), words=_cases(parser))


def fish(parser: argparse.ArgumentParser) -> str:
    """For fish, with each word's help."""
    return _FISH.format(
        commands=_commands(parser, " "),
        words="\n".join(
            f"        case {_quoted(place)}\n            printf '%s\\n' "
            + " ".join(_quoted(f"{word}\t{text}" if text else word) for word, text in words)
            for place, words in _places(parser)
        ),
    )


def _places(parser: argparse.ArgumentParser) -> list[tuple[str, list[tuple[str, str]]]]:
    """What is offered after each command, and after each option that has a list."""
    from sidestep.validation.scenarios.library import built_in_scenarios

    scenes = [(name, "") for name in built_in_scenarios()]
    places = []
    for one in every_command(parser):
        takes_scenes = any(action.metavar == _SCENARIO for action in one._actions)
        listed = [
            (str(choice), "")
            for action in one._actions
            if action.choices and not action.option_strings and not isinstance(action, argparse._SubParsersAction)
            for choice in action.choices
        ]
        places.append((one.prog, [*words_of(one), *listed, *(scenes if takes_scenes else [])]))
        places += [(f"{one.prog} {option}", [(c, "") for c in values]) for option, values in choices_of(one).items()]
    return places


def _cases(parser: argparse.ArgumentParser) -> str:
    return "\n".join(
        f"    {_quoted(place)}) offered={_quoted(' '.join(word for word, _ in words))} ;;"
        for place, words in _places(parser)
    )


def _commands(parser: argparse.ArgumentParser, between: str = "|") -> str:
    """Every way from a command to one below it."""
    return between.join(_quoted(f"{one.prog} {name}") for one in every_command(parser) for name, _ in commands_of(one))


def _quoted(words: str) -> str:
    return shlex.quote(" ".join(words.split(" ")).replace("\n", " "))


_BASH = """# sidestep completion for bash: eval "$(sidestep completion bash)"
_sidestep() {{
  local place=sidestep word offered= current="${{COMP_WORDS[COMP_CWORD]}}"
  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    case "$place $word" in {commands}) place="$place $word" ;; esac
  done
  _sidestep_offer "$place ${{COMP_WORDS[COMP_CWORD-1]}}"
  [ -n "$offered" ] || _sidestep_offer "$place"
  COMPREPLY=($(compgen -W "$offered" -- "$current") $(compgen -f -- "$current"))
}}
_sidestep_offer() {{
  case "$1" in
{words}
  esac
}}
complete -o filenames -F _sidestep sidestep"""

_ZSH = """# sidestep completion for zsh: eval "$(sidestep completion zsh)"
_sidestep() {{
  local place=sidestep word offered=
  for word in ${{words[2,CURRENT-1]}}; do
    case "$place $word" in {commands}) place="$place $word" ;; esac
  done
  _sidestep_offer "$place ${{words[CURRENT-1]}}"
  [ -n "$offered" ] || _sidestep_offer "$place"
  compadd -- ${{=offered}}
  _files
}}
_sidestep_offer() {{
  case "$1" in
{words}
  esac
}}
(( $+functions[compdef] )) || {{ autoload -Uz compinit && compinit; }}
compdef _sidestep sidestep"""

_FISH = """# sidestep completion for fish: sidestep completion fish | source
function __sidestep_offer
    set -l place sidestep
    set -l before (commandline -opc)
    for word in $before[2..]
        if contains -- "$place $word" {commands}
            set place "$place $word"
        end
    end
    set -l offered (__sidestep_words "$place $before[-1]")
    test -n "$offered"; or set offered (__sidestep_words $place)
    printf '%s\\n' $offered
end
function __sidestep_words
    switch "$argv[1]"
{words}
    end
end
complete -c sidestep -a '(__sidestep_offer)'"""

_SHELLS: dict[str, Callable[[argparse.ArgumentParser], str]] = {"bash": bash, "zsh": zsh, "fish": fish}
