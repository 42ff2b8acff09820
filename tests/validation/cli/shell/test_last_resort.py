"""What the command says of errors that nobody foresaw, and what it does about closed streams and planted links."""

import json
import os
import subprocess
import sys

import pytest

from sidestep.validation.campaigns.journal import open_journal
from sidestep.validation.cli import scenarios
from sidestep.validation.cli.main import main
from sidestep.validation.cli.shell.last_resort import MOST_LETTERS, one_line
from sidestep.validation.files import companion, write_text


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("no \x1b[31mway"), "unforeseen ValueError: no \\x1b[31mway (test_last_resort.py:"),
        (RecursionError("deep"), "unforeseen RecursionError: deep"),
        (MemoryError(), "out of memory (MemoryError), "),
        (OSError("no number"), "unforeseen OSError: no number"),
        (KeyError("k" * 5000), "unforeseen KeyError"),
    ],
)
def test_the_last_resort_is_one_line_with_the_file(error, said, tmp_path, monkeypatch, capsys):
    def fail(*_):
        raise error

    (tmp_path / "scene.toml").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sidestep.validation.scenarios.library.read_scenario", fail)
    assert main(["run", "scene.toml"]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"sidestep: {said}")
    assert "'scene.toml'" in told
    assert told.count("\n") == 1
    assert len(told) <= MOST_LETTERS + 12


def test_the_traceback_is_there_for_who_asks(monkeypatch, capsys):
    def fail(*_):
        raise ValueError("no")

    monkeypatch.setattr("sidestep.validation.scenarios.library.read_scenario", fail)
    monkeypatch.setenv("SIDESTEP_TRACEBACK", "1")
    assert main(["run", "x"]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_long_lines_keep_both_ends():
    line = one_line("a" * 3000 + "\n" + "b" * 3000)
    assert len(line) == MOST_LETTERS
    assert line.startswith("aaa")
    assert line.endswith("bbb")


def test_what_is_printed_is_cleaned(monkeypatch, capsys):
    monkeypatch.setattr(scenarios, "json", type("J", (), {"dumps": staticmethod(lambda *_, **__: "\x1b[2Jtext")}))
    assert main(["scenarios", "--schema"]) == 0
    assert capsys.readouterr().out == "\\x1b[2Jtext\n"


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams(closed):
    command = f"{sys.executable} -m sidestep.validation scenarios {closed}"
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


def test_a_link_that_waits_leads_nowhere(tmp_path):
    victim, out = tmp_path / "victim", tmp_path / "out"
    victim.write_text("mine")
    out.mkdir()
    (out / ".part-a.txt").symlink_to(victim)
    write_text(out / "a.txt", "theirs")
    assert victim.read_text() == "mine"
    assert (out / "a.txt").read_text() == "theirs"
    assert sorted(file.name for file in out.iterdir()) == [".part-a.txt", "a.txt"]


def test_what_a_killed_process_left_is_swept_up_after_an_hour(tmp_path):
    old, young = tmp_path / f".part-{'0' * 16}-a.txt", tmp_path / f".part-{'1' * 16}-a.txt"
    other = tmp_path / f".part-{'2' * 16}-b.txt"
    for file in (old, young, other):
        file.write_text("half")
    os.utime(old, (1.0, 1.0))
    os.utime(other, (1.0, 1.0))
    write_text(tmp_path / "a.txt", "whole")
    assert sorted(tmp_path.iterdir()) == sorted([young, other, tmp_path / "a.txt"])


def test_files_beside_others_never_hit_them(tmp_path):
    assert companion(tmp_path / "car.toml", ".identified.json").name == "car.identified.json"
    assert companion(tmp_path / "car.v2", ".identified.json").name == "car.v2.identified.json"
    assert companion(tmp_path / "scene.png", ".png").name == "scene.png.png"


HOLD = """
import sys
from pathlib import Path
from sidestep.validation.campaigns.journal import open_journal
with open_journal(Path(sys.argv[1]), {"campaign": 1}):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.skipif(not os.path.exists("/proc/locks"), reason="Linux tells who holds a lock")
def test_who_holds_a_journal_is_named(tmp_path):
    file = tmp_path / "campaign.jsonl"
    command = [sys.executable, "-c", HOLD, str(file)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout
        assert holder.stdout.readline() == "held\n"
        with (
            pytest.raises(ValueError, match=rf"is being written by another process, {holder.pid} \(python"),
            open_journal(file, {"campaign": 1}),
        ):
            pass
        holder.communicate("")
    assert json.loads(file.read_text()) == {"campaign": 1}


@pytest.mark.parametrize("name", [".", "..", "a\n", "a/b", "", "x" * 101, "\x1b[2J"])
@pytest.mark.parametrize("kind", ["campaign", "run"])
def test_names_that_would_lead_elsewhere(name, kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = f"name = {json.dumps(name)}\n"
    text += 'scenario = "random"\n' if kind == "campaign" else "speed = 5.0\nduration = 0.1\n[road]\n"
    (tmp_path / "a.toml").write_text(text)
    assert main([kind, "a.toml"]) == 2
    assert "name: " in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["a.toml"]
