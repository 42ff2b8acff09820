"""The CAN database, its frames and the typed records on them."""

import itertools
import math
from dataclasses import FrozenInstanceError, fields, replace

import cantools.database
import e2e.crc
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.controller.can_port.actuator import ActuatorConfig
from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec import samples
from sidestep.controller.can_port.codec.database import load_dbc, messages
from sidestep.controller.can_port.protection.e2e import ACCEPTED, CheckStatus, Receiver
from sidestep.controller.can_port.protection.e2e_state import E2EState, StateConfig
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState

MESSAGES = list(messages().values())
SIGNALS = [(message, signal) for message in MESSAGES for signal in message.signals]
by_name = pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
by_signal = pytest.mark.parametrize(("message", "signal"), SIGNALS, ids=lambda x: x.name)
numbers = st.floats(allow_nan=True, allow_infinity=True)


def safe_values(message):
    return {signal.name: signal.safe * signal.scale for signal in message.signals}


def crc8_h2f(data):
    """CRC-8/AUTOSAR bit by bit: polynomial 0x2F, start and final exclusive-or 0xFF."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ (0x2F if crc & 0x80 else 0)
        crc &= 0xFF
    return crc ^ 0xFF


# --- database


def test_dbc_is_strictly_consistent_and_complete():
    database = load_dbc()
    assert [(x.name, x.frame_id, x.length, x.cycle_time) for x in database.messages] == [
        ("STEER_CMD", 0x101, 8, 10),
        ("STEER_STATUS", 0x102, 8, 10),
        ("DRIVE_CMD", 0x103, 8, 10),
        ("VEH_DYN", 0x201, 8, 10),
        ("VEH_POS", 0x202, 8, 10),
        ("VEH_HEADING", 0x203, 8, 10),
        ("STATE_EXACT", 0x210, 64, 10),
        ("CTRL_STATUS", 0x301, 8, 100),
    ]
    for message in database.messages:
        if message.name == "STATE_EXACT":
            continue
        assert message.send_type == "Cyclic"
        assert message.comment
        assert message.senders
        assert all(signal.receivers for signal in message.signals)
        for s in message.signals:  # the packing of `database` relies on these
            assert s.byte_order == "little_endian"
            assert s.offset == 0
            raw = sorted(round(limit / s.scale) for limit in (s.minimum, s.maximum))
            assert raw[0] >= (-(1 << s.length - 1) if s.is_signed else 0)
            assert raw[1] < (1 << s.length - s.is_signed)
            assert raw[0] <= (s.raw_initial or 0) <= raw[1]


def test_catalogue_has_the_database_s_cycles_and_senders():
    got = {name: (message.cycle, message.sender) for name, message in messages().items()}
    assert got == {
        "STEER_CMD": (pytest.approx(0.01), "CTRL"), "DRIVE_CMD": (pytest.approx(0.01), "CTRL"),
        "STEER_STATUS": (pytest.approx(0.01), "EPS"),
        "VEH_DYN": (pytest.approx(0.01), "VEH"), "VEH_POS": (pytest.approx(0.01), "VEH"),
        "VEH_HEADING": (pytest.approx(0.01), "VEH"), "CTRL_STATUS": (pytest.approx(0.1), "CTRL"),
    }  # fmt: skip


@by_name
def test_protection_header_is_where_profile_2_wants_it(message):
    dbc = load_dbc().get_message_by_name(message.name)
    header = [(s.name.split("_")[1], s.start, s.length) for s in dbc.signals if s.start < message.profile.header_bits]
    assert header == [("CRC", 0, 8), ("Counter", 8, 4)]
    assert len(message.profile.data_ids) == 16


@pytest.mark.parametrize(
    ("signal", "enum"),
    [
        ("SteerCmd_Status", Status),
        ("CtrlStatus_Status", Status),
        ("SteerCmd_Mode", m.SteerMode),
        ("CtrlStatus_Mode", m.SteerMode),
        ("SteerStatus_State", m.ActuatorState),
        ("SteerStatus_E2EState", E2EState),
        ("CtrlStatus_QpStatus", m.QpStatus),
    ],
)
def test_value_tables_are_the_enums(signal, enum):
    (found,) = [s for x in load_dbc().messages for s in x.signals if s.name == signal]
    assert {int(number): str(name) for number, name in found.choices.items()} == {x.value: x.name for x in enum}


@pytest.mark.parametrize("kind", ["dbc", "kcd", "sym"])
def test_database_survives_export(kind, tmp_path):
    file = tmp_path / f"steer.{kind}"
    cantools.database.dump_file(load_dbc(), str(file))
    again = cantools.database.load_file(file, strict=True)
    assert {x.name: [(s.name, s.start, s.length, s.scale) for s in x.signals] for x in again.messages} == {
        x.name: [(s.name, s.start, s.length, s.scale) for s in x.signals] for x in load_dbc().messages
    }


# --- packing


@by_signal
def test_every_step_of_a_signal_comes_back_and_cantools_agrees(message, signal):
    dbc = load_dbc().get_message_by_name(message.name)
    for raw in {*range(signal.low, signal.high + 1, max(1, (signal.high - signal.low) // 997)), signal.high}:
        values = safe_values(message) | {signal.name: raw * signal.scale}
        data = message.encode(values, counter=raw)
        theirs = dbc.decode(data, decode_choices=False)
        assert round(message.decode(data)[signal.name] / signal.scale) == raw
        assert {name: theirs[name] for name in values} == pytest.approx(message.decode(data), abs=1e-12)
        assert theirs[message.signals[0].name.split("_")[0] + "_Counter"] == raw % 16


@by_signal
def test_out_of_range_stops_at_the_limit_on_both_sides(message, signal):
    for limit, outwards in ((signal.low, -1), (signal.high, 1)):
        for beyond in (0, 1, 2, 1 << 16, 1 << 40):
            value = (limit + outwards * beyond) * signal.scale
            data = message.encode(safe_values(message) | {signal.name: value}, 0)
            assert round(message.decode(data)[signal.name] / signal.scale) == limit
        inside = (limit - outwards) * signal.scale
        data = message.encode(safe_values(message) | {signal.name: inside}, 0)
        assert round(message.decode(data)[signal.name] / signal.scale) == limit - outwards


@by_name
@given(data=st.data())
def test_any_numbers_make_a_valid_frame_within_half_a_step(message, data):
    values = {signal.name: data.draw(numbers) for signal in message.signals}
    frame = message.encode(values, 7)
    assert Receiver(message.profile, message.length).check(frame) is CheckStatus.INITIAL
    decoded = message.decode(frame)
    if not all(map(math.isfinite, values.values())):
        assert decoded == safe_values(message)
        return
    for s in message.signals:
        nearest = min(max(values[s.name], s.low * s.scale), s.high * s.scale)
        assert abs(decoded[s.name] - nearest) <= 0.5 * s.scale * (1 + 1e-9)


@pytest.mark.parametrize("protection", ["P02", "P05", "none"])
def test_reserved_bits_are_those_that_nothing_uses(protection):
    for name, message in messages(protection).items():
        full = message.encode({s.name: s.high * s.scale for s in message.signals}, 15)
        assert not int.from_bytes(full, "little") & message.reserved
        bits = sum(s.length for s in load_dbc(protection).get_message_by_name(name).signals)
        assert message.reserved.bit_count() == 8 * message.length - bits
    assert messages()["STEER_CMD"].reserved == 0
    assert messages()["VEH_POS"].reserved == 7 << 13


# --- protection


def test_crc_is_the_catalogued_one():
    assert e2e.crc.calculate_crc8_h2f(b"123456789") == crc8_h2f(b"123456789") == 0xDF


def test_frame_computed_by_hand():
    data = m.encode_steer_command(SteeringCommand(0.0, 0.1, 15.0, Status.DEGRADED), counter=5, rate_limit=0.5)
    # counter 5, mode 2, enable 1 | 2000 steps | 100 steps, 1500 steps << 10, status 1 << 24, answers what is not known
    payload = bytes([0x05 | 2 << 4 | 1 << 7, 0xD0, 0x07, 0x64, 0x70, 0x17, 0x01 | 63 << 2])
    data_id = bytes.fromhex("084b8ed1195c9fe22a6db0f33b7ec109")[5]
    assert data == bytes([crc8_h2f(payload + bytes([data_id]))]) + payload
    assert data[1:].hex() == "a5d007647017fd"


@by_name
def test_every_single_bit_flip_is_detected_at_every_counter(message):
    for counter, bit in itertools.product(range(16), range(8 * message.length)):
        data = bytearray(message.encode(safe_values(message), counter))
        data[bit // 8] ^= 1 << bit % 8
        assert message.profile.counter_of(data) is None


@by_name
def test_bursts_behind_the_counter_up_to_a_byte_are_detected(message):
    word = int.from_bytes(message.encode(safe_values(message), 3), "big")
    for burst in range(1, 256):
        for shift in range(8 * (message.length - 2) - 7):
            assert message.profile.counter_of((word ^ burst << shift).to_bytes(message.length, "big")) is None


def test_a_frame_under_the_wrong_identifier_is_detected():
    for sender, receiver in itertools.permutations(MESSAGES, 2):
        for counter in range(16):
            assert receiver.profile.counter_of(sender.encode(safe_values(sender), counter)) is None


def test_receiver_judges_by_the_step_of_the_counter():
    frames = [m.encode_steer_command(SteeringCommand(0.0, 0.0, 0.0), counter) for counter in range(16)]
    expected = {0: "REPEATED", 1: "OK", 2: "OKSOMELOST", 3: "OKSOMELOST"}
    for last, step in itertools.product(range(16), range(16)):
        receiver = Receiver(m.STEER_CMD.profile, m.STEER_CMD.length)
        assert receiver.check(frames[last]) is CheckStatus.INITIAL
        assert receiver.check(frames[(last + step) % 16]).name == expected.get(step, "WRONGSEQUENCE")


def test_receiver_rejects_wrong_lengths_and_counts():
    receiver = Receiver(m.STEER_CMD.profile, m.STEER_CMD.length)
    data = m.encode_steer_command(SteeringCommand(0.0, 0.0, 0.0), 0)
    for wrong in (b"", data[:1], data[:7], data + b"\0"):
        assert receiver.check(wrong) is CheckStatus.ERROR
    assert receiver.check(None) is CheckStatus.NONEWDATA
    assert receiver.check(data) is CheckStatus.INITIAL
    assert receiver.check(data) is CheckStatus.REPEATED
    assert receiver.counts == {
        CheckStatus.ERROR: 4,
        CheckStatus.NONEWDATA: 1,
        CheckStatus.INITIAL: 1,
        CheckStatus.REPEATED: 1,
    }


def test_a_corrupt_frame_does_not_move_the_counter():
    receiver = Receiver(m.STEER_CMD.profile, m.STEER_CMD.length)
    first, second = (m.encode_steer_command(SteeringCommand(0.0, 0.0, 0.0), counter) for counter in (0, 1))
    receiver.check(first)
    assert receiver.check(bytes([second[0] ^ 1]) + second[1:]) is CheckStatus.ERROR
    assert receiver.check(second) in ACCEPTED


# --- steering command

angles = st.floats(-m.MAX_ANGLE, m.MAX_ANGLE)
speeds = st.floats(0.0, 163.83)


@given(angles, speeds, st.sampled_from(Status), st.integers(0, 10**6), st.booleans(), st.floats(0.0, m.MAX_RATE_LIMIT))
def test_command_round_trip(angle, speed, status, counter, enable, rate_limit):
    frame = m.decode_steer_command(
        m.encode_steer_command(SteeringCommand(1.0, angle, speed, status), counter, enable, rate_limit), time=2.0
    )
    assert frame.enable is enable
    assert frame.command.time == 2.0
    assert frame.command.steer_angle == pytest.approx(angle if enable else 0.0, abs=2.5e-5 * (1 + 1e-9))
    assert frame.command.target_speed == pytest.approx(speed, abs=0.005 * (1 + 1e-9))
    assert frame.command.status is status
    assert frame.rate_limit == pytest.approx(rate_limit, abs=0.0025 * (1 + 1e-9))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["steer_angle", "target_speed"])
def test_what_is_not_finite_disables_the_steering(field, bad):
    command = replace(SteeringCommand(0.0, 0.3, 15.0), **{field: bad})
    frame = m.decode_steer_command(m.encode_steer_command(command, 0), 0.0)
    assert frame == m.SteerFrame(SteeringCommand(0.0, 0.0, 0.0, Status.FAULT), enable=False, rate_limit=0.0)


def test_implausible_intact_frames_are_not_enabled():
    good = {
        "SteerCmd_Mode": 2,
        "SteerCmd_Enable": 1,
        "SteerCmd_Angle": 0.2,
        "SteerCmd_RateLimit": 1.0,
        "SteerCmd_TargetSpeed": 15.0,
        "SteerCmd_Status": 0,
        "SteerCmd_Answers": 0.2,
    }
    dbc = load_dbc().get_message_by_name("STEER_CMD")

    def decoded(**changes):
        values = {"SteerCmd_CRC": 0, "SteerCmd_Counter": 0} | good | changes
        return m.decode_steer_command(dbc.encode(values, strict=False), 0.0)

    def enabled(**changes):
        frame = decoded(**changes)
        assert frame.plausible == frame.enable  # a good angle without enable, or the other way round
        return frame.enable

    assert enabled()
    assert enabled(SteerCmd_Angle=1.6)
    assert enabled(SteerCmd_Angle=-1.6)
    assert not enabled(SteerCmd_Angle=1.60005)
    assert not enabled(SteerCmd_Angle=-1.6384)
    assert not any(enabled(SteerCmd_Mode=mode) for mode in range(8) if mode != 2)
    assert not enabled(SteerCmd_Enable=0)
    for mode in (0, 1, 7):
        assert decoded(SteerCmd_Mode=mode, SteerCmd_Enable=0, SteerCmd_Angle=0.0).plausible
        assert not decoded(SteerCmd_Mode=mode, SteerCmd_Enable=0, SteerCmd_Angle=5e-5).plausible
        assert not decoded(SteerCmd_Mode=mode, SteerCmd_Angle=0.0).plausible
    assert not decoded(SteerCmd_Mode=2, SteerCmd_Enable=0, SteerCmd_Angle=0.0).plausible


# --- vehicle state and status


@given(
    st.builds(
        VehicleState,
        time=st.just(0.5),
        x=st.floats(-8000, 8000),
        y=st.floats(-8000, 8000),
        yaw=st.floats(-200, 200),
        v_x=st.floats(-80, 80),
        v_y=st.floats(-30, 30),
        yaw_rate=st.floats(-3, 3),
        steer_angle=st.just(0.25),
    ),
    st.floats(-3.1, 3.1),
)
def test_vehicle_state_round_trip(state, yaw_error):
    frames = samples.encode_vehicle_state(state, 4.2, 9)
    got = samples.decode_vehicle_state(frames, time=0.5, steer_angle=0.25, near_yaw=state.yaw + yaw_error)
    assert got is not None
    for name, half_step in {"x": 5e-4, "y": 5e-4, "yaw": 2e-5, "v_x": 2.5e-3, "v_y": 5e-4, "yaw_rate": 5e-5}.items():
        assert getattr(got, name) == pytest.approx(getattr(state, name), abs=half_step * (1 + 1e-6)), name
    assert (got.time, got.steer_angle) == (0.5, 0.25)
    assert samples.VEH_DYN.decode(frames[0])["VehDyn_AccLat"] == pytest.approx(4.2)
    assert samples.decode_vehicle_state(frames, 0.5).steer_angle == 0.0


@given(st.lists(st.floats(allow_nan=False), min_size=8, max_size=8))
def test_the_exact_state_is_exact_and_cantools_reads_it(numbers):
    state = VehicleState(*numbers)
    frame = samples.exact_frame(state)
    assert samples.exact_state(frame.data) == state
    assert (frame.arbitration_id, frame.is_fd, frame.channel) == (samples.EXACT_ID, True, samples.LOG_CHANNEL)
    assert list(load_dbc().get_message_by_name("STATE_EXACT").decode(bytes(frame.data)).values()) == numbers


@given(st.integers(0, 10**6))
def test_a_command_names_the_sample_it_answers(number):
    frames = samples.encode_vehicle_state(VehicleState(time=0.01 * number), 0.0, 0)
    told = round(samples.VEH_HEADING.decode(frames[2])["VehHeading_Sample"] / 0.01)
    assert told == number % samples.SAMPLES
    command = SteeringCommand(0.0, 0.1, 15.0)
    frame = m.decode_steer_command(m.encode_steer_command(command, 0, answers=told), 0.0)
    assert frame.answers == number % samples.SAMPLES % m.ANSWERS
    assert m.decode_steer_command(m.encode_steer_command(command, 0), 0.0).answers is None


@pytest.mark.parametrize("field", ["x", "y", "yaw", "v_x", "v_y", "yaw_rate"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_vehicle_state_that_is_not_finite_is_not_valid(field, bad):
    frames = samples.encode_vehicle_state(replace(VehicleState(v_x=15.0), **{field: bad}), 0.0, 0)
    assert samples.decode_vehicle_state(frames, 0.0) is None


def test_heading_is_taken_as_it_comes_unless_another_is_near():
    for yaw in (3.0, -3.0):
        frames = samples.encode_vehicle_state(VehicleState(yaw=yaw, v_x=15.0), 0.0, 0)
        assert samples.decode_vehicle_state(frames, 0.0).yaw == pytest.approx(yaw)


def test_a_sample_is_three_messages():
    with pytest.raises(ValueError, match="zip"):
        samples.encode_vehicle_state(VehicleState(), 0.0, 0, sample=samples.VEHICLE_STATE[:2])
    with pytest.raises(ValueError, match="zip"):
        samples.decode_vehicle_state([bytes(8)] * 2, 0.0)


def test_only_more_than_8_bytes_need_can_fd():
    assert [replace(m.STEER_CMD, length=length).is_fd for length in (7, 8, 9)] == [False, False, True]


def test_status_round_trips():
    for state, e2e_state in itertools.product(m.ActuatorState, E2EState):
        status = m.SteerStatus(state, -0.12345, 0.5, e2e_state, 123)
        assert m.decode_steer_status(m.encode_steer_status(status, 3)) == replace(status, angle=pytest.approx(-0.12345))
    for qp_status, mode, status in itertools.product(m.QpStatus, m.SteerMode, Status):
        report = m.ControllerStatus(qp_status, status, mode, 0.000123, 0.0015, 17)
        got = m.decode_controller_status(m.encode_controller_status(report, 3))
        assert got == replace(report, solve_time=pytest.approx(0.000123), slack=pytest.approx(0.0015))


@pytest.mark.parametrize("record", [
    m.SteerStatus(m.ActuatorState.HOLD, 0.0, 0.0, E2EState.VALID, 0),
    m.ControllerStatus(m.QpStatus.SOLVED, Status.TRACKING, m.SteerMode.ANGLE, 0.0, 0.0, 0),
    m.STEER_CMD, m.STEER_CMD.profile, messages("P05")["STEER_CMD"].profile, ActuatorConfig(), StateConfig(4, 2, 1),
], ids=lambda record: type(record).__name__)  # fmt: skip
def test_records_do_not_change(record):
    with pytest.raises(FrozenInstanceError):
        setattr(record, fields(record)[0].name, None)


def test_numbers_without_a_name_read_as_the_worst():
    assert m.ActuatorState(9) is m.ActuatorState.FAULT
    assert m.QpStatus(9) is m.QpStatus.NUMERICS
    assert m.SteerMode(5) is m.SteerMode.FAULT
    assert E2EState(7) is E2EState.INVALID
