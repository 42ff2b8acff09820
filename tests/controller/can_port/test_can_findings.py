"""What the actuator's end makes of the commands in the long run: every way a drive can be nobody's own."""

import pytest

from sidestep.controller.can_port.actuator import Actuator
from sidestep.controller.can_port.codec.database import CYCLE, messages
from sidestep.controller.can_port.codec.messages import ActuatorState, encode_steer_command
from sidestep.controller.can_port.findings import CommandWatch, findings
from sidestep.plant_models.signals import SteeringCommand, VehicleState


class Drive:
    """An actuator whose wheels follow at once, watched, and what is sent to it cycle by cycle."""

    def __init__(self, protection="P02"):
        self.message = messages(protection)["STEER_CMD"]
        self.actuator = Actuator(None, self.message)
        self.watch, self.cycle, self.angle = CommandWatch(self.actuator), 0, 0.0

    def frame(self, counter, angle=0.1, **more):
        return encode_steer_command(SteeringCommand(0.0, angle, 15.0), counter, message=self.message, **more)

    def step(self, *frames):
        time = self.cycle * CYCLE
        state = VehicleState(time, v_x=15.0, steer_angle=self.angle)
        self.angle = self.actuator.step(frames, state).steer_angle
        self.watch.see(time, frames)
        self.cycle += 1

    def run(self, cycles, also=lambda k: ()):
        for _ in range(cycles):
            self.step(self.frame(self.cycle), *also(self.cycle))

    def labels(self, **more):
        return [finding.label for finding in findings(self.watch.record(**more))]

    def verdict(self):
        return findings(self.watch.record())[0].verdict


@pytest.fixture(params=["P02", "P05"])
def driving(request):
    drive = Drive(request.param)
    for _ in range(5):
        drive.step()  # nobody there yet: that is before it counts
    drive.run(30)
    drive.watch.begin((drive.cycle - 1) * CYCLE)
    return drive


def test_a_clean_drive_has_no_findings(driving):
    driving.run(200)
    record = driving.watch.record()
    assert findings(record) == ()
    assert (record.cycles, record.lost, record.longest_silence) == (200, 0, pytest.approx(CYCLE))
    assert record.seconds_in == {ActuatorState.ACTIVE: pytest.approx(2.0)}
    assert {status.value: count for status, count in record.checks.items()} == {"OK": 200}


def test_a_controller_that_falls_silent(driving):
    driving.run(50)
    for _ in range(40):
        driving.step()
    assert driving.labels() == ["controller silent", "fail-safe", "commands bridged"]
    record = driving.watch.record()
    assert driving.verdict() == "fail"
    assert record.silent_at_end == pytest.approx(0.4)
    assert record.fail_safe == pytest.approx(0.35)
    assert record.checks["NONEWDATA"] == 40


def test_commands_that_come_and_are_not_accepted_are_not_silence(driving):
    driving.run(50)
    for k in range(60):  # every other cycle nothing, then two at once: never 14 good ones of 16
        frames = [driving.frame(driving.cycle + j) for j in range(2)] if k >= 30 and k % 2 else []
        driving.step(*frames)
    assert driving.labels()[0] == "commands not accepted"
    assert driving.verdict() == "fail"


def test_a_controller_that_came_back_was_in_fail_safe(driving):
    driving.run(50)
    for _ in range(20):
        driving.step()
    driving.run(100)
    assert "controller silent" not in driving.labels()
    assert "fail-safe" in driving.labels()
    assert driving.verdict() == "fail"


def test_a_short_gap_is_a_pass_that_says_so(driving):
    driving.run(50)
    for _ in range(3):
        driving.step()
    driving.run(50)
    assert driving.labels() == ["wrong sequence", "commands bridged"]  # the counter went on while nothing came


def test_a_gap_without_a_jump_is_bridged():
    drive = Drive("none")
    drive.run(40)
    drive.watch.begin((drive.cycle - 1) * CYCLE)
    drive.run(20)
    for _ in range(4):
        drive.step()
    drive.run(20)
    assert drive.labels() == ["commands bridged"]
    assert drive.verdict() == "pass"


@pytest.mark.parametrize("offset", range(16))
def test_two_controllers_on_one_bus(driving, offset):
    driving.run(100, also=lambda k: [driving.frame(k + offset, angle=0.2)])
    assert driving.labels()[0] == "second sender"
    assert driving.verdict() == "inconclusive"


def test_two_controllers_that_agree_bit_for_bit(driving):
    driving.run(100, also=lambda k: [driving.frame(k)])
    assert driving.labels()[0] == "second sender"


def test_one_spoofed_command_under_the_counter_that_is_due(driving):
    driving.run(50)
    driving.step(driving.frame(driving.cycle, angle=0.101), driving.frame(driving.cycle))
    driving.run(50)
    assert driving.labels() == ["second sender"]


def test_frames_of_a_burst_are_of_one_sender(driving):
    driving.run(50)
    late = [driving.frame(driving.cycle + k) for k in range(15)]
    for _ in range(15):
        driving.step()
    driving.step(*late)
    driving.run(40)
    assert "second sender" not in driving.labels()


def test_a_node_that_slept_is_not_taken_for_two_senders(driving):
    driving.run(50)
    late = [driving.frame(driving.cycle + k) for k in range(100)]
    driving.cycle += 99
    driving.step(*late)
    driving.run(50)
    assert "second sender" not in driving.labels()


def test_strangers_and_implausible_wrong_and_corrupt_commands(driving):
    driving.run(50)
    assert driving.labels(strangers=3) == ["second sender"]
    driving.step(driving.frame(driving.cycle, angle=1.5))  # cannot be reached in time
    driving.run(20)
    assert driving.labels() == ["implausible commands"]
    driving.step(driving.frame(driving.cycle)[::-1])
    driving.run(20)
    assert driving.labels() == ["implausible commands", "corrupt commands"]
    driving.cycle += 4
    driving.run(20)
    assert driving.labels()[1:3] == ["wrong sequence", "corrupt commands"]
    assert driving.verdict() == "inconclusive"


def test_a_controller_that_asks_not_to_be_followed(driving):
    driving.run(50)
    for _ in range(30):
        driving.step(driving.frame(driving.cycle, enable=False))
    assert driving.labels() == ["fail-safe"]
    assert driving.watch.record().as_dict()["seconds_in"]["STANDBY"] == pytest.approx(0.3)
