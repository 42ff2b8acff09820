"""What a terminal shows: help with examples, what may have been meant, completion, tables on narrow ones."""

import re
import shlex
import shutil
import subprocess

import pytest

from sidestep.validation.cli.main import _parser, main
from sidestep.validation.cli.shell.completion import bash, fish, zsh
from sidestep.validation.cli.shell.examples import EXAMPLES
from sidestep.validation.cli.shell.parser import every_command, options_of
from sidestep.validation.console import new_table, print_runs, show

SUMMARY = {
    "scenario": "scene [x]", "plant": "m:f [y]", "preset": "default", "verdict": "pass", "label": "ok", "error": None,
    "detail": "", "min_clearance_m": 0.25, "max_lateral_acceleration": 2.0, "max_steer_rate": 0.1,
    "rms_lateral_error_m": 0.5, "infeasible_steps": 0, "step_time_us": {"median": 70.0, "p99": 100.0},
    "can": {"sent": 800},
}  # fmt: skip


@pytest.mark.parametrize("parser", list(every_command(_parser())), ids=lambda parser: parser.prog)
def test_every_help_ends_with_an_example_that_the_command_takes(parser):
    assert parser.format_help().rstrip().endswith(EXAMPLES[parser.prog])
    command = EXAMPLES[parser.prog].replace('eval "$(', "").replace(')"', "")
    assert command.startswith(parser.prog)
    assert callable(_parser().parse_args(shlex.split(command)[1:]).command)


def test_examples_are_of_commands_that_exist():
    assert set(EXAMPLES) == {parser.prog for parser in every_command(_parser())}


@pytest.mark.parametrize(
    ("typed", "meant", "place"),
    [
        ("rnu moose", "run", "sidestep"),
        ("can montor", "monitor", "sidestep can"),
        ("run moose --plnat mujoco", "--plant", "sidestep run"),
        ("limits moose --plnat=mujoco", "--plant", "sidestep limits moose"),
    ],
)
def test_a_mistyped_word_is_answered_with_the_nearest(capsys, typed, meant, place):
    with pytest.raises(SystemExit) as left:
        main(typed.split())
    assert left.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"did you mean {meant}? (see {place} --help)" in line


def test_a_word_like_no_other_is_answered_without_a_guess(capsys):
    with pytest.raises(SystemExit):
        main(["run", "moose", "--zzzzzz"])
    assert "did you mean" not in capsys.readouterr().err


def offered(shell, script, *words):
    """What the Tab key offers after `words`, by the shell itself."""
    if shutil.which(shell) is None:
        pytest.skip(f"needs {shell}")
    last = len(words) - 1
    quoted = " ".join(f"'{word}'" for word in words)
    calls = {
        "bash": f"COMP_WORDS=({quoted}); COMP_CWORD={last}; _sidestep; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        "zsh": f"words=({quoted}); CURRENT={last + 1}; _sidestep",
        "fish": f"complete -C {shlex.quote(' '.join(words))}",
    }
    stand_ins = {"zsh": 'compdef() { : }; compadd() { shift; print -l -- "$@" }; _files() { : };\n'}
    text = stand_ins.get(shell, "") + script + "\n" + calls[shell]
    options = {"bash": ["--norc"], "zsh": ["-f"], "fish": ["--no-config"]}[shell]
    found = subprocess.run([shell, *options, "-c", text], capture_output=True, text=True, check=True, timeout=60)
    assert found.stderr == ""
    return {line.split("\t")[0] for line in found.stdout.splitlines()}


@pytest.mark.parametrize(("shell", "script"), [("bash", bash), ("zsh", zsh), ("fish", fish)])
def test_the_tab_key_offers_commands_options_values_and_scenarios(tmp_path, monkeypatch, shell, script):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    text = script(_parser())
    assert {"run", "campaign", "completion"} <= offered(shell, text, "sidestep", "")
    assert {"monitor", "replay"} <= offered(shell, text, "sidestep", "can", "")
    found = offered(shell, text, "sidestep", "run", "--")
    assert {"--plant", "--coupling"} <= found
    assert "--jobs" not in found
    assert offered(shell, text, "sidestep", "run", "--coupling", "") == {"zero-delay", "one-step-delay"}
    assert {"moose", "double-obstacle"} <= offered(shell, text, "sidestep", "run", "")
    assert {"bash", "zsh", "fish"} <= offered(shell, text, "sidestep", "completion", "")


def test_the_command_writes_what_the_shell_reads(capsys):
    assert main(["completion", "bash"]) == 0
    assert capsys.readouterr().out == bash(_parser()) + "\n"


def test_words_in_brackets_are_no_markup(capsys):
    table = new_table("Valid up to [m/s2], [bold]", "first [m]", "second [s]")
    table.add_row("a", "b")
    show(table)
    shown = " ".join(capsys.readouterr().out.split())  # a long title is broken to the table's width
    assert "Valid up to [m/s2], [bold]" in shown
    assert "first [m]" in shown
    assert "second [s]" in shown


@pytest.mark.parametrize("width", [50, 130])
def test_a_narrow_terminal_gets_a_figure_a_line(capsys, monkeypatch, width):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("COLUMNS", str(width))
    print_runs([SUMMARY])
    shown = [line.rstrip() for line in _plain(capsys.readouterr().out).splitlines()]
    assert max(map(len, shown)) <= width
    assert any("scene [x]" in line for line in shown)
    assert any("m:f [y]" in line for line in shown)
    assert ("  max steer rate [deg/s]: 5.7" in shown) == (width == 50)
    assert ("  verdict: pass: ok" in shown) == (width == 50)


def _plain(text):

    return re.sub(r"\x1b\[[0-9;]*m", "", text)


def test_options_are_those_of_the_command():
    (run,) = (parser for parser in every_command(_parser()) if parser.prog == "sidestep run")
    assert "--plant" in options_of(run)
