"""The steering port: what goes in comes out of the bus, and nothing else does."""

import math
import random
from dataclasses import replace

import can
import pytest
from support.can_port.frames import assert_same_but_quantised, slalom

from sidestep.controller.can_port.bus.bus import Bus
from sidestep.controller.can_port.codec.database import CYCLE, load_dbc, messages
from sidestep.controller.can_port.codec.messages import (
    STEER_CMD,
    decode_drive_command,
    decode_steer_command,
    encode_steer_command,
)
from sidestep.controller.can_port.port import SteeringPort
from sidestep.controller.can_port.protection.e2e import CheckStatus
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status, SteeringCommand


def test_cycle_is_the_database_one():
    assert pytest.approx(0.01) == CYCLE


def test_every_command_arrives():
    commands = slalom(500)
    with SteeringPort("auto") as port:
        for command in commands:
            assert_same_but_quantised(port.transmit(command), command)
        assert (port.sent, port.lost) == (500, 0)
        assert port.receiver.counts == {CheckStatus.INITIAL: 1, CheckStatus.OK: 499}


def test_off_hands_the_command_through(tmp_path):
    log = tmp_path / "can.blf"
    with SteeringPort("off", log) as port:
        command = SteeringCommand(0.0, 0.123456789, 15.0)
        assert port.transmit(command) is command
        assert (port.interface, port.sent, port.lost) == ("off", 0, 0)
    assert not log.exists()


def test_a_command_that_is_not_finite_never_raises_and_never_steers():
    with SteeringPort("auto") as port:
        got = port.transmit(SteeringCommand(0.0, math.nan, 15.0))
        assert got == SteeringCommand(0.0, 0.0, 0.0, Status.FAULT)


def test_two_ports_do_not_hear_each_other():
    with SteeringPort("auto") as one, SteeringPort("auto") as two:
        for command in slalom(50):
            one.transmit(command)
            assert_same_but_quantised(
                two.transmit(replace(command, steer_angle=-command.steer_angle)),
                replace(command, steer_angle=-command.steer_angle),
            )
        assert one.receiver.counts[CheckStatus.OK] == two.receiver.counts[CheckStatus.OK] == 49


def test_garbage_on_the_bus_is_ignored():
    draw = random.Random(1)
    with SteeringPort("virtual:garbage") as port, Bus("virtual:garbage") as vandal:
        for command in slalom(200):
            for _ in range(draw.randrange(4)):
                frame_id = draw.choice([0x101, 0x101, draw.randrange(0x800)])
                data = draw.randbytes(draw.choice([0, 1, 7, 8]))
                if STEER_CMD.profile.counter_of(data.ljust(2, b"\0")) is None or len(data) != 8:
                    vandal.send(can.Message(arbitration_id=frame_id, data=data, is_extended_id=False))
            assert_same_but_quantised(port.transmit(command), command)
        assert port.lost == 0
        assert port.receiver.counts[CheckStatus.ERROR] > 50


def test_a_replayed_frame_is_not_applied():
    old = encode_steer_command(SteeringCommand(0.0, 0.5, 15.0), 0)
    with SteeringPort("virtual:replay") as port, Bus("virtual:replay") as vandal:
        commands = slalom(40)
        for k, command in enumerate(commands):
            if k % 16 == 9:
                vandal.send(can.Message(arbitration_id=STEER_CMD.frame_id, data=old, is_extended_id=False))
            # the counter jumps there and back: both frames are refused, the cycle after is good again
            assert_same_but_quantised(port.transmit(command), commands[k - 1] if k % 16 == 9 else command)
        assert port.receiver.counts[CheckStatus.WRONGSEQUENCE] == 4
        assert port.lost == 2


def test_what_the_bus_does_not_take_is_lost_and_the_last_command_held(monkeypatch):
    commands = slalom(30)
    with SteeringPort("virtual:lossy") as port:
        assert_same_but_quantised(port.transmit(commands[0]), commands[0])
        send = port._bus.send
        monkeypatch.setattr(port._bus, "send", lambda message: False)
        assert_same_but_quantised(port.transmit(commands[1]), commands[0])
        monkeypatch.setattr(port._bus, "send", send)
        assert_same_but_quantised(port.transmit(commands[2]), commands[2])
        assert (port.sent, port.lost) == (2, 1)
        assert port.receiver.counts[CheckStatus.OKSOMELOST] == 1


def test_a_frame_that_arrives_twice_counts_once(monkeypatch):
    with SteeringPort("virtual:twice") as port:
        send = port._bus.send
        monkeypatch.setattr(port._bus, "send", lambda message: send(message) and send(message))
        for command in slalom(20):
            assert_same_but_quantised(port.transmit(command), command)
        assert (port.sent, port.lost) == (20, 0)
        assert port.receiver.counts[CheckStatus.REPEATED] == 19  # the last one still waits


def test_nothing_arrived_yet():
    with SteeringPort("virtual:deaf") as port:
        port._bus.receive = lambda timeout=0.0: None
        assert port.transmit(SteeringCommand(0.0, 0.1, 15.0)) is None
        assert (port.sent, port.lost) == (1, 1)


# --- log


def test_log_decodes_back_to_the_commands_in_time(tmp_path):
    commands = slalom(3000, start=5.0)  # more than one BLF container, and not from zero
    with SteeringPort("auto", tmp_path / "can.blf") as port:
        applied = [port.transmit(command) for command in commands]
    with can.BLFReader(tmp_path / "can.blf") as log:
        every = list(log)
    drives, frames = every[0::2], every[1::2]
    got = [
        replace(decode_steer_command(frame.data, command.time).command, acceleration=decode_drive_command(drive.data))
        for drive, frame, command in zip(drives, frames, commands, strict=True)
    ]
    assert got == applied
    assert [frame.timestamp for frame in frames] == pytest.approx([command.time for command in commands], abs=2e-9)
    theirs = load_dbc().get_message_by_name("STEER_CMD")
    assert all(theirs.decode(frame.data)["SteerCmd_Enable"] == "ON" for frame in frames)
    assert {(f.arbitration_id, f.is_extended_id, f.channel, f.is_rx, f.dlc) for f in frames} == {
        (0x101, False, 0, False, 8)
    }
    assert {frame.arbitration_id for frame in drives} == {0x103}


def test_log_holds_what_others_sent_too(tmp_path):
    with SteeringPort("virtual:log", tmp_path / "can.blf") as port, Bus("virtual:log") as other:
        other.send(can.Message(arbitration_id=0x123, data=b"\1\2", is_extended_id=False))
        port.transmit(SteeringCommand(0.25, 0.0, 15.0))
    with can.BLFReader(tmp_path / "can.blf") as log:
        assert [(f.arbitration_id, f.is_rx, f.timestamp) for f in log] == [
            (0x123, True, 0.25), (0x103, False, 0.25), (0x101, False, 0.25),
        ]  # fmt: skip


def test_log_is_complete_after_an_exception(tmp_path):
    def interrupted():
        with SteeringPort("auto", tmp_path / "can.blf") as port:
            for command in slalom(10):
                port.transmit(command)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with can.BLFReader(tmp_path / "can.blf") as log:
        assert [frame.arbitration_id for frame in log] == [0x103, 0x101] * 10


def test_log_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match=r"can\.blf: cannot write the CAN log: No such file or directory"):
        SteeringPort("auto", tmp_path / "missing" / "can.blf")


def test_a_bad_bus_leaves_no_log_behind(tmp_path):
    with pytest.raises(InputError):
        SteeringPort("nonsense:1", tmp_path / "can.blf")
    assert list(tmp_path.iterdir()) == []


def test_closing_twice_does_no_harm(tmp_path):
    port = SteeringPort("auto", log=tmp_path / "can.blf")
    port.transmit(slalom(1)[0])
    port.close()
    written = (tmp_path / "can.blf").read_bytes()
    port.close()
    assert (tmp_path / "can.blf").read_bytes() == written
    with can.LogReader(tmp_path / "can.blf") as log:
        assert [frame.arbitration_id for frame in log] == [0x103, 0x101]


@pytest.mark.parametrize("protection", ["P05", "none"])
def test_other_protections(protection, tmp_path):
    commands = slalom(300)
    with SteeringPort("auto", tmp_path / "can.blf", message=messages(protection)["STEER_CMD"]) as port:
        for command in commands:
            assert_same_but_quantised(port.transmit(command), command)
        assert (port.sent, port.lost) == (300, 0)
    with can.BLFReader(tmp_path / "can.blf") as log:
        assert {(frame.is_fd, frame.dlc) for frame in log} == {(True, 12) if protection == "P05" else (False, 8)}
