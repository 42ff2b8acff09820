"""Ctrl-C: files are complete, and waiting ends."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import can
import pytest
from support.folders import files
from support.stand_in import KinematicCar

from sidestep.validation.cli.main import main
from sidestep.validation.interrupt import interrupts_between_steps
from sidestep.validation.loop.recording import read_columns
from sidestep.validation.studies import runs as runs_module


def test_an_interrupt_leaves_complete_files_of_what_ran(monkeypatch, tmp_path, capsys):
    car = KinematicCar(raises=KeyboardInterrupt(), raises_at=0.25)
    monkeypatch.setattr(runs_module, "open_plant", lambda scenario: car)
    assert main(["run", "single-obstacle", "--out", "a"]) == 130
    assert files(tmp_path / "a") == ["can.blf", "recording.csv", "report.html", "steps.csv", "summary.json"]
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert (summary["label"], summary["verdict"]) == ("interrupted", "inconclusive")
    recording = read_columns(tmp_path / "a" / "recording.csv")
    assert recording["time"][-1] == pytest.approx(0.25)
    frames = [frame for frame in can.BLFReader(tmp_path / "a" / "can.blf") if frame.arbitration_id == 0x101]
    assert len(frames) == len(recording["time"])
    output = capsys.readouterr()
    assert "a/report.html" in output.out
    assert output.err == "sidestep: interrupted\n"


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def test_ctrl_c_waits_until_it_is_asked_for():
    done = []

    def work():
        with interrupts_between_steps() as interruption:
            interruption()
            press_ctrl_c()
            done.append("the step")
            interruption()
            done.append("the next one")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["the step"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_that_nobody_asks_for_is_raised_at_the_end():
    done = []

    def work():
        with interrupts_between_steps():
            press_ctrl_c()
            done.append("the file")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["the file"]


def test_a_second_ctrl_c_does_not_wait():
    def work():
        with interrupts_between_steps():
            press_ctrl_c()
            press_ctrl_c()
            pytest.fail("it was held back")

    with pytest.raises(KeyboardInterrupt):
        work()


def test_other_threads_are_left_alone():
    def work():
        with interrupts_between_steps() as interruption:
            interruption()
            return signal.getsignal(signal.SIGINT)

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(work).result() is signal.default_int_handler


def test_ctrl_c_from_outside(tmp_path):
    command = [sys.executable, "-m", "sidestep.validation", "run", "single-obstacle", "--plant", "linear", "--out", "a"]
    process = subprocess.Popen(
        [*command, "--set", "duration=600", "--set", "road.segments.0.length=1e5"], cwd=tmp_path,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not (tmp_path / "a" / "can.blf").exists():
        assert process.poll() is None
        time.sleep(0.02)
    time.sleep(0.3)
    os.kill(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert error == "sidestep: interrupted\n"
    assert json.loads((tmp_path / "a" / "summary.json").read_text())["label"] == "interrupted"
