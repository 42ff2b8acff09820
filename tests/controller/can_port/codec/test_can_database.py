"""The CAN database: complete, consistent, and packed as cantools packs it."""

import math

import cantools.database
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.can_port.own_messages import by_name, by_signal, numbers, safe_values

from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec.database import load_dbc, messages
from sidestep.controller.can_port.protection.e2e import CheckStatus, Receiver
from sidestep.controller.can_port.protection.e2e_state import E2EState
from sidestep.plant_models.signals import Status


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
