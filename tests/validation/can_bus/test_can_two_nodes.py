"""Two nodes in two processes and what may happen between them: the verdict names it, at both ends."""

import json
import os
import signal
import subprocess
import sys
import time
from threading import Thread

import can
import pytest

from sidestep.controller.can_port.bus.bus import Bus
from sidestep.controller.can_port.bus.log import read_log
from sidestep.controller.can_port.codec.messages import decode_steer_command
from sidestep.validation.can_bus.replay import compare
from sidestep.validation.cli.main import main
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.report import report
from sidestep.validation.scenarios.scenario import load_scenario

OPEN_ROAD = ("--set", "obstacles=[]", "--set", "duration=1.5")


class Drive:
    """`can plant` in this process and `can drive` in another, on a bus of their own."""

    def __init__(self, spec, folder):
        self.spec, self.folder, self.nodes, self.told = spec, folder, [], None

    def node(self, name):
        arguments = ("drive", "single-obstacle", "--can", self.spec, *OPEN_ROAD, "--out", str(self.folder / name))
        process = subprocess.Popen([sys.executable, "-m", "sidestep.validation", "can", *arguments])
        self.nodes.append(process)
        return process

    def plant(self, *more):
        arguments = ("plant", "single-obstacle", "--can", self.spec, *OPEN_ROAD, "--plant", "linear", *more)
        return main(["can", *arguments, "--out", str(self.folder / "plant")])

    def while_driving(self, happens):
        """Call it half a second after the first enabled command; with the bus and that command's frame."""

        def wait():
            with Bus(self.spec) as bus:
                frame = next(f for f in iter(lambda: bus.receive(60.0), None) if enabled(f))
                time.sleep(0.5)
                happens(bus, frame)

        thread = Thread(target=wait)
        thread.start()
        return thread

    def summary(self, name="plant"):
        return json.loads((self.folder / name / "summary.json").read_text())

    def labels(self, name="plant"):
        return [finding["label"] for finding in self.summary(name)["findings"]]


def enabled(message):
    return message.arbitration_id == 0x101 and decode_steer_command(message.data, 0.0).enable


@pytest.fixture
def drive(multicast_spec, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "run_report", lambda run: "<!doctype html>")
    drive = Drive(multicast_spec, tmp_path)
    yield drive
    for process in drive.nodes:
        process.kill()
        process.wait()


def test_an_undisturbed_drive_passes_at_both_ends_and_can_be_asked_again(drive):
    controller = drive.node("controller")
    status = drive.plant()
    assert controller.wait(30.0) == (drive.summary("controller")["verdict"] != "pass")
    assert status == (drive.summary()["verdict"] != "pass")
    assert "vehicle silent" not in drive.labels("controller")
    if not drive.summary()["can"]["skipped"]:  # a machine that stands still is told, see the other tests
        assert (drive.labels(), drive.labels("controller")) == ([], [])
    scenario = load_scenario("single-obstacle", ["obstacles=[]"])
    for name in ("plant", "controller"):
        columns, _ = compare(read_log(drive.folder / name / "can.blf"), bare_controller(scenario))
        assert len(columns["time"]) > 100
        assert (columns["difference"] == 0.0).all()


def test_a_controller_killed_in_the_middle_is_no_pass(drive):
    controller = drive.node("controller")
    drive.while_driving(lambda bus, frame: controller.kill())
    assert drive.plant() == 1
    summary = drive.summary()
    assert (summary["verdict"], summary["label"]) == ("fail", "controller silent")
    assert summary["can"]["silent_at_end_s"] > 0.3
    assert summary["can"]["checks"]["NONEWDATA"] > 30


def test_a_controller_that_stood_still_for_a_while_is_no_pass(drive):
    controller = drive.node("controller")

    def stop(bus, frame):
        controller.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        controller.send_signal(signal.SIGCONT)

    drive.while_driving(stop)
    assert drive.plant() == 1
    assert drive.summary()["verdict"] == "fail"
    assert "fail-safe" in drive.labels()
    assert controller.wait(30.0) == 1


def test_two_controllers_are_no_pass(drive):
    first, second = drive.node("one"), drive.node("two")
    status = drive.plant()
    assert (status, drive.summary()["label"]) == (1, "second sender")
    for process, name in ((first, "one"), (second, "two")):
        assert process.wait(30.0) == 1
        assert drive.labels(name)[0] == "second sender"


def test_spoofed_commands_and_states_are_no_pass(drive):
    controller = drive.node("controller")

    def spoof(bus, frame):
        for _ in range(20):
            bus.send(frame)
            bus.send(can.Message(arbitration_id=0x201, data=bytes(8), is_extended_id=False))
            time.sleep(0.01)

    drive.while_driving(spoof)
    assert drive.plant() == 1
    assert drive.summary()["verdict"] != "pass"
    assert drive.summary()["label"] == "second sender"
    assert drive.summary()["can"]["strangers"] == 20
    assert controller.wait(30.0) == 1
    assert drive.labels("controller")[0] == "second sender"


def test_a_vehicle_killed_in_the_middle_is_no_pass_for_the_controller(drive):
    arguments = ("plant", "single-obstacle", "--can", drive.spec, *OPEN_ROAD, "--plant", "linear")
    vehicle = subprocess.Popen([sys.executable, "-m", "sidestep.validation", "can", *arguments, "--out",
                                str(drive.folder / "plant")])  # fmt: skip
    drive.nodes.append(vehicle)
    drive.while_driving(lambda bus, frame: os.kill(vehicle.pid, signal.SIGKILL))
    assert drive.node("controller").wait(120.0) == 1
    assert (drive.summary("controller")["label"], drive.summary("controller")["verdict"]) == ("vehicle silent", "fail")
