"""What tools/vcanbox.py does without booting: exit statuses and one-line errors."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[1] / "tools" / "vcanbox.py"


@pytest.fixture
def vcanbox():
    spec = importlib.util.spec_from_file_location("vcanbox", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def python(code):
    return [sys.executable, "-c", code]


def run(vcanbox, monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["vcanbox.py", *arguments])
    return vcanbox.main()


def test_native_command_keeps_its_exit_status_and_knows_where_it_runs(vcanbox, monkeypatch):
    monkeypatch.setattr(vcanbox, "native_can", lambda interfaces: interfaces == ["vcan0", "vcan1"])
    code = "import os, sys; sys.exit(7 if os.environ['VCANBOX'] == 'native' else 1)"
    assert run(vcanbox, monkeypatch, "--interfaces", "vcan0,vcan1", "--", *python(code)) == 7


def test_exit_statuses(vcanbox, monkeypatch, capsys):
    monkeypatch.setattr(vcanbox, "native_can", lambda interfaces: True)
    assert run(vcanbox, monkeypatch, "--", *python("import os; os.kill(os.getpid(), 9)")) == 137
    assert run(vcanbox, monkeypatch, "--", "no-such-command") == 127
    assert run(vcanbox, monkeypatch, "--timeout", "0.2", "--", *python("import time; time.sleep(30)")) == 124
    assert capsys.readouterr().err == "vcanbox: no such command: no-such-command\nvcanbox: timed out after 0.2 s\n"


def test_nowhere_to_get_a_kernel_from(vcanbox, monkeypatch, capsys, tmp_path):
    def refuse(command, folder):
        raise subprocess.CalledProcessError(100, command, stderr="E: Unable to locate package user-mode-linux\n")

    monkeypatch.setattr(vcanbox, "run_quietly", refuse)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert run(vcanbox, monkeypatch, "--boot", "--", "true") == 125
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "cannot be fetched (E: Unable to locate package user-mode-linux); try apt-get update" in error
    assert list((tmp_path / "vcanbox").iterdir()) == []


def test_help_of_the_script_itself():
    done = subprocess.run([sys.executable, TOOL, "--help"], capture_output=True, text=True, check=True)
    assert "--interfaces" in done.stdout
    assert os.access(TOOL, os.X_OK)
