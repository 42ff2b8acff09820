"""`sidestep can drive` and `sidestep can plant` as two processes over multicast."""

import json
import os
import signal
import subprocess
import sys
from threading import Thread

from sidestep.controller.can_port.bus.bus import Bus
from sidestep.controller.can_port.bus.log import read_log
from sidestep.controller.can_port.codec.messages import decode_steer_command
from sidestep.validation.cli.main import main
from sidestep.validation.report import report


def node(*arguments):
    return subprocess.Popen([sys.executable, "-m", "sidestep.validation", "can", *arguments])


def test_interrupted_nodes_complete_their_logs_and_the_last_command_is_not_enabled(
    multicast_spec,
    tmp_path,
    monkeypatch,
):
    monkeypatch.setattr(report, "run_report", lambda run: "<!doctype html>")
    common = ["single-obstacle", "--can", multicast_spec]
    with Bus(multicast_spec) as bus, node("drive", *common, "--out", str(tmp_path / "c")) as controller:

        def interrupt_when_it_steers():
            if any(map(_enabled, iter(lambda: bus.receive(60.0), None))):
                controller.send_signal(signal.SIGTERM)
                os.kill(os.getpid(), signal.SIGINT)

        Thread(target=interrupt_when_it_steers).start()
        assert main(["can", "plant", *common, "--plant", "linear", "--out", str(tmp_path / "p")]) == 130
        assert controller.wait(60.0) == 130
    for name, other in (("c", 0x201), ("p", 0x101)):
        assert json.loads((tmp_path / name / "summary.json").read_text())["can"]["refused"] == 0
        assert other in {frame.arbitration_id for frame in read_log(tmp_path / name / "can.blf")}
    logged = [frame for frame in read_log(tmp_path / "c" / "can.blf") if frame.arbitration_id == 0x101]
    assert any(map(_enabled, logged))
    assert not _enabled(logged[-1])


def _enabled(message):
    return message.arbitration_id == 0x101 and decode_steer_command(message.data, 0.0).enable


def test_two_processes_drive_over_multicast(multicast_spec, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "run_report", lambda run: "<!doctype html>")  # test_report.py looks at it
    common = ["single-obstacle", "--can", multicast_spec, "--set", "duration=1.0", "--set", "obstacles=[]"]
    with node("drive", *common, "--out", str(tmp_path / "c")) as controller:
        status = main(["can", "plant", *common, "--plant", "linear", "--out", str(tmp_path / "p")])
        assert controller.wait(30.0) in (0, 1)
    assert {file.name for file in (tmp_path / "p").iterdir()} == {
        "can.blf", "recording.csv", "report.html", "steps.csv", "summary.json",
    }  # fmt: skip
    assert {file.name for file in (tmp_path / "c").iterdir()} == {"can.blf", "summary.json"}
    theirs = json.loads((tmp_path / "p" / "summary.json").read_text())
    assert status == (theirs["verdict"] != "pass")
    if not theirs["can"]["skipped"]:  # a machine that stands still is told, and no pass
        assert theirs["verdict"] == "pass"
    assert theirs["can"]["refused"] == theirs["can"]["implausible"] == 0
