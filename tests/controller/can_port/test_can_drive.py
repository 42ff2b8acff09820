"""DRIVE_CMD: the acceleration on its way to the plant, and what counts where it does not arrive."""

import math
from dataclasses import replace

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.controller.can_port.actuator import Actuator
from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec.catalogue import mapped_bus
from sidestep.controller.can_port.codec.database import CYCLE, messages
from sidestep.controller.can_port.port import SteeringPort
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState

ASKED = SteeringCommand(0.0, 0.02, 12.0, acceleration=-2.5)
CAR = VehicleState(v_x=12.0)


@given(st.floats(-40.0, 40.0), st.integers(0, 400))
def test_an_acceleration_comes_back_within_half_a_step(acceleration, counter):
    data = m.encode_drive_command(replace(ASKED, acceleration=acceleration), counter)
    expected = min(max(acceleration, -32.768), 32.767)
    assert m.decode_drive_command(data) == pytest.approx(expected, abs=0.0005 * (1 + 1e-9))
    assert m.DRIVE_CMD.profile.counter_of(data) == counter % 16


@pytest.mark.parametrize("missing", [math.nan, math.inf])
def test_none_is_told_where_none_is_given(missing):
    assert math.isnan(m.decode_drive_command(m.encode_drive_command(replace(ASKED, acceleration=missing), 0)))
    assert math.isnan(m.decode_drive_command(m.encode_drive_command(ASKED, 0, enable=False)))


@pytest.mark.parametrize("protection", ["P02", "P05", "none"])
def test_it_goes_with_our_own_steering_message_only(protection):
    ours = messages(protection)
    assert m.drive_message(ours["STEER_CMD"]) is ours["DRIVE_CMD"]
    assert "DRIVE_CMD" not in mapped_bus("tesla").messages
    assert m.drive_message(mapped_bus("tesla").messages["STEER_CMD"]) is None


def test_beside_somebody_else_s_message_it_reaches_the_plant_of_a_run():
    with SteeringPort("virtual:drive-mapped", message=mapped_bus("tesla").messages["STEER_CMD"]) as port:
        got = port.transmit(ASKED)
    assert got is not None
    assert (got.target_speed, got.acceleration) == (12.0, -2.5)


def test_a_frame_that_the_bus_does_not_take_leaves_the_target_speed(monkeypatch):
    with SteeringPort("virtual:drive-lost") as port:
        port.transmit(ASKED)
        send = port._bus.send
        monkeypatch.setattr(port._bus, "send", lambda frame: frame.arbitration_id != 0x103 and send(frame))
        got = port.transmit(replace(ASKED, time=0.01))
        assert got is not None
        assert (got.target_speed, math.isnan(got.acceleration)) == (12.0, True)
        assert (port.sent, port.lost) == (2, 0)
        monkeypatch.undo()
        again = port.transmit(replace(ASKED, time=0.02))
        assert again is not None
        assert again.acceleration == pytest.approx(-2.5)


def test_a_second_sender_of_it_is_noticed():
    with SteeringPort("virtual:drive-stranger") as port, can.Bus("drive-stranger", interface="virtual") as other:
        other.send(can.Message(arbitration_id=0x103, data=m.encode_drive_command(ASKED, 9), is_extended_id=False))
        port.transmit(ASKED)
        assert port.strangers == 1


class Bench:
    """An actuator that gets both commands every cycle, unless one is left out or spoilt."""

    def __init__(self):
        self.actuator = Actuator(drive=m.DRIVE_CMD)
        self.cycle = 0

    def step(self, steer=True, drive=True, enable=True, spoil=0, command=ASKED):
        frames = [m.encode_steer_command(command, self.cycle, enable)] if steer else []
        data = bytearray(m.encode_drive_command(command, self.cycle, enable))
        data[2] ^= spoil
        answer = self.actuator.step(frames, replace(CAR, time=self.cycle * CYCLE), [bytes(data)] if drive else [])
        self.cycle += 1
        return answer

    def settled(self):
        for _ in range(20):
            answer = self.step()
        return answer


def test_the_actuator_hands_it_on_while_it_follows():
    bench = Bench()
    assert bench.settled().acceleration == pytest.approx(-2.5)
    assert math.isnan(bench.step(enable=False).acceleration)


@pytest.mark.parametrize("how", [{"drive": False}, {"spoil": 1}])
def test_what_does_not_arrive_intact_is_held_for_50_ms(how):
    bench = Bench()
    bench.settled()
    answers = [bench.step(**how) for _ in range(8)]
    assert [math.isnan(answer.acceleration) for answer in answers] == [False] * 5 + [True] * 3
    assert {answer.target_speed for answer in answers} == {12.0}
    assert {answer.status for answer in answers} == {Status.TRACKING}


def test_a_silent_controller_stops_the_car_by_its_speed():
    bench = Bench()
    bench.settled()
    answers = [bench.step(steer=False, drive=False) for _ in range(10)]
    assert answers[1].acceleration == pytest.approx(-2.5)  # held with the angle
    assert (answers[-1].target_speed, answers[-1].status) == (0.0, Status.FAULT)
    assert math.isnan(answers[-1].acceleration)


def test_a_mapping_file_carries_it(tmp_path):
    (tmp_path / "bench.dbc").write_text("""VERSION ""
BS_:
BU_: A B
BO_ 400 CMD: 8 A
 SG_ Angle : 0|16@1- (0.01,0) [0|0] "deg" B
 SG_ Accel : 16|16@1- (0.001,0) [0|0] "g" B
 SG_ On : 32|1@1+ (1,0) [0|1] "" B
""")
    (tmp_path / "bus.toml").write_text("""dbc = "bench.dbc"
[command]
message = "CMD"
angle = { signal = "Angle" }
acceleration = { signal = "Accel" }
enable = [{ signal = "On" }]
""")
    message = mapped_bus(str(tmp_path / "bus.toml")).messages["STEER_CMD"]
    got = m.decode_steer_command(m.encode_steer_command(ASKED, 0, message=message), 0.0, message).command
    assert got.acceleration == pytest.approx(-2.5, abs=0.005)
    off = m.decode_steer_command(m.encode_steer_command(ASKED, 0, False, message=message), 0.0, message).command
    assert math.isnan(off.acceleration)
