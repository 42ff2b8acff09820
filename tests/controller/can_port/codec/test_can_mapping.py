"""Somebody else's messages by mapping files: every bit by cantools, every refusal by its place."""

import math
import tomllib

import cantools.database
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.can_port.foreign_dbc import DBC, LONG, MOTOROLA

from sidestep.controller.can_port.codec import mapping
from sidestep.controller.can_port.codec.catalogue import MAPS, built_in_maps, mapped_bus
from sidestep.controller.can_port.codec.database import EXTENDED
from sidestep.controller.can_port.codec.messages import (
    ActuatorState,
    SteerStatus,
    decode_steer_command,
    encode_steer_command,
    steer_status_values,
)
from sidestep.controller.can_port.protection.checksums import RULES, Parameters
from sidestep.controller.can_port.protection.e2e_state import E2EState
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status, SteeringCommand

THEIRS = cantools.database.load_string(DBC, "dbc")
SHIPPED = {
    name: mapped_bus(name, wheelbase=2.8)
    for name in built_in_maps()
    if tomllib.loads((MAPS / f"{name}.toml").read_text(encoding="utf-8")).get("dbc")
}
"""Those that come with a database; read once, for hypothesis measures time."""


@pytest.fixture
def bus(tmp_path):
    def made(text, dbc=DBC, **more):
        (tmp_path / "a.dbc").write_text(dbc)
        (tmp_path / "bus.toml").write_text('dbc = "a.dbc"\n' + text)
        return mapped_bus(str(tmp_path / "bus.toml"), **more)

    return made


def decoded(bus, message, data):
    return bus.databases[1].get_message_by_name(message.name).decode(data, decode_choices=False)


@given(st.floats(-1.5, 1.5), st.floats(0.0, 100.0), st.booleans(), st.integers(0, 1000))
def test_a_motorola_multiplexed_command_is_cantools_own(angle, speed, enable, counter):
    theirs = THEIRS
    file = mapping.msgspec.convert(tomllib.loads(MOTOROLA), mapping.BusFile)
    from sidestep.controller.can_port.codec import catalogue

    message = catalogue._command(theirs, file.command, "", None)
    data = encode_steer_command(SteeringCommand(0.0, angle, speed), counter, enable, 1.0, message)
    values = theirs.get_message_by_name("MOTOROLA").decode(data, decode_choices=False)
    assert values["Angle"] == pytest.approx(-math.degrees(angle) * 15.0 if enable else 0.0, abs=0.05 + 1e-9)
    assert values["Speed"] == pytest.approx(3.6 * speed, abs=0.05 + 1e-9)
    assert (values["Request"], values["Mode"]) == (2 if enable else 1, 2)
    assert values["Counter"] == [0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12, 13, 14][counter % 14]
    again = decode_steer_command(data, 3.0, message)
    assert (again.enable, again.plausible, again.answers) == (enable, True, None)
    assert again.command.target_speed == pytest.approx(speed, abs=0.05 / 3.6 + 1e-9)
    assert again.command.steer_angle == pytest.approx(angle if enable else 0.0, abs=math.radians(0.05 / 15) + 1e-9)
    assert again.command.status is (Status.TRACKING if enable else Status.FAULT)
    assert message.profile.counter_of(data) == counter % 14
    for bit in range(64):
        broken = bytearray(data)
        broken[bit // 8] ^= 1 << bit % 8
        assert message.profile.counter_of(broken) is None


@pytest.mark.parametrize("angle", [-0.2, 0.2, 0.0])
def test_an_extended_fd_message_with_a_sign_bit(bus, angle):
    described = bus(LONG)
    message = described.messages["STEER_CMD"]
    assert (message.frame_id, message.is_fd, message.length) == (2566834800, True, 24)
    assert message.frame_id & EXTENDED
    data = encode_steer_command(SteeringCommand(0.0, angle, 15.0), 0, True, 1.0, message)
    values = decoded(described, message, data)
    assert values["Curve"] == pytest.approx(abs(math.tan(angle)) / 2.5, abs=3.4e-6)
    assert values["Curve_VZ"] == (1 if angle < 0.0 else 0)
    assert decode_steer_command(data, 0.0, message).command.steer_angle == pytest.approx(angle, abs=1e-5)


def test_what_comes_back(bus):
    described = bus(MOTOROLA)
    assert "STEER_STATUS" not in described.messages
    message = described.messages["feedback[0] BACK"]
    assert (message.cycle, message.sender, message.tied) == (pytest.approx(0.02), "EPS", False)
    status = SteerStatus(ActuatorState.ACTIVE, 0.3, 0.0, E2EState.VALID, 0)
    moves = {"VehDyn_Speed": 15.0, "VehDyn_YawRate": -0.2, "VehDyn_AccLat": 0.0}
    data = message.encode(steer_status_values(status) | moves, 300)
    values = decoded(described, message, data)
    assert values["Wheel"] == pytest.approx(math.degrees(0.3) * 15.0, abs=0.025)  # its [0|1] is no limit
    assert (values["State"], values["Fault"], values["Alive"]) == (3, 0, 44)
    got = message.decode(data)
    assert got["SteerStatus_State"] == ActuatorState.ACTIVE
    assert got["VehDyn_Speed"] == pytest.approx(15.0, abs=0.002)
    assert got["VehDyn_YawRate"] == pytest.approx(-0.2, abs=1e-4)
    for state, raw in ((ActuatorState.FAULT, 9), (ActuatorState.HOLD, 9), (ActuatorState.STANDBY, 1)):
        data = message.encode(steer_status_values(SteerStatus(state, 0.0, 0.0, E2EState.VALID, 0)) | moves, 0)
        assert decoded(described, message, data)["State"] == raw
        assert decoded(described, message, data)["Fault"] == (state is ActuatorState.FAULT)


@pytest.mark.parametrize("name", SHIPPED)
@given(angle=st.floats(-0.05, 0.05), counter=st.integers(0, 100), enable=st.booleans())
def test_shipped_maps_are_within_half_a_step(name, angle, counter, enable):
    message = SHIPPED[name].messages["STEER_CMD"]
    data = encode_steer_command(SteeringCommand(0.0, angle, 15.0), counter, enable, 0.5, message)
    number = message.numbers[0]
    step = abs(number.signal.scale / number.ratio) * (2.8 * 1.01 if name == "ford" else 1.0)
    got = decode_steer_command(data, 0.0, message)
    assert got.command.steer_angle == pytest.approx(angle if enable else 0.0, abs=0.5 * step + 1e-12)
    assert got.enable is enable


@pytest.mark.parametrize(("name", "command", "counter", "frame"), [
    # 9.95 deg to the right is raw 16483 = 0x4063; type 1 and counter 5 are 0x45; the checksum adds 0x04 and 0x88
    ("tesla", SteeringCommand(0.0, math.radians(-9.95) / 12.0, 15.0), 5, "40634574"),
    # 0.01 1/m to the left is raw 1500; what is not used stands at its zero: 4096, 1000 and 512
    ("ford", SteeringCommand(0.0, math.atan(0.028), 15.0), 0, "bb90007d04800000"),
    ("pacmod3", SteeringCommand(0.0, -0.5 / 16.0, 15.0), 0, "01fe0c0ce4000000"),
])  # fmt: skip
def test_known_vectors(name, command, counter, frame):
    message = mapped_bus(name, wheelbase=2.8).messages["STEER_CMD"]
    assert encode_steer_command(command, counter, True, 3.3 / 16.0, message).hex() == frame


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["tesla", "ford", "pacmod3"])
def test_what_is_not_finite_asks_for_nothing(name, bad):
    message = mapped_bus(name, wheelbase=2.8).messages["STEER_CMD"]
    got = decode_steer_command(
        encode_steer_command(SteeringCommand(0.0, bad, 15.0), 0, True, 0.5, message), 0.0, message
    )
    assert (got.enable, got.command.steer_angle, got.plausible) == (False, 0.0, True)


@pytest.mark.parametrize(("angle", "curvature"), [(0.3, 0.02094), (-0.3, -0.02)])
def test_out_of_range_stops_at_the_limit_on_both_sides(angle, curvature):
    described = mapped_bus("ford", wheelbase=2.8)
    message = described.messages["STEER_CMD"]
    data = encode_steer_command(SteeringCommand(0.0, angle, 15.0), 0, True, 0.5, message)
    assert decoded(described, message, data)["LatCtlCurv_No_Actl"] == pytest.approx(curvature)


# --- checksums


@pytest.mark.parametrize(("rule", "frame", "frame_id", "at", "more", "expected"), [
    ("j1850", b"123456789", 0, 99, {}, 0x4B),  # the catalogued check value
    ("crc", b"123456789", 0, 99, {"polynomial": 0x07}, 0xF4),  # CRC-8/SMBUS
    ("crc", b"123456789", 0, 99, {"width": 16, "polynomial": 0x8005, "reflect": True}, 0xBB3D),  # CRC-16/ARC
    ("crc", b"123456789", 0, 99, {"width": 16, "polynomial": 0x1021, "initial": 0xFFFF}, 0x29B1),  # CRC-16/IBM-3740
    ("sum", bytes([1, 2, 255, 9]), 0, 3, {}, 2),
    ("xor", bytes([1, 2, 4, 9]), 0, 3, {}, 7),
    ("toyota", bytes([0, 0, 0, 0, 0, 0, 0, 0]), 0x191, 7, {}, 0x91 + 1 + 8),
    ("honda", bytes(8), 0x1E, 7, {}, (8 - 1 - 14) & 0xF),
])  # fmt: skip
def test_rules_by_their_check_values(rule, frame, frame_id, at, more, expected):
    assert RULES[rule](frame_id, frame, at, 0, Parameters(**more)) == expected


def test_autosar_profiles_are_autosar_e2e_s():
    from e2e.p01 import e2e_p01_protect
    from e2e.p02 import e2e_p02_protect
    from e2e.p05 import e2e_p05_protect

    data_ids = bytes(range(40, 56))
    for counter in range(15):
        data = bytearray([0, counter, 3, 250, 5, 6, 7, 8])
        e2e_p01_protect(data, 0x1234, increment_counter=False)
        assert RULES["autosar-1"](0, bytes([0, *data[1:]]), 0, counter, Parameters(data_id=0x1234)) == data[0]
        e2e_p02_protect(data, data_ids, increment_counter=False)
        assert RULES["autosar-2"](0, bytes([0, *data[1:]]), 0, counter, Parameters(data_ids=data_ids)) == data[0]
        e2e_p05_protect(data, 0x1234, increment_counter=False)
        bare = bytes([0, 0, *data[2:]])
        assert RULES["autosar-5"](0, bare, 0, counter, Parameters(data_id=0x1234)) == int.from_bytes(data[:2], "little")


# --- refusals


@pytest.mark.parametrize(("change", "words"), [
    (("[command]", "[comand]"), "unknown field `comand`"),
    (('message = "MOTOROLA"', 'message = "MOTORLA"'), "message: no message 'MOTORLA' in the database; allowed: BACK"),
    (('signal = "Angle"', 'signal = "Angel"'), "command.angle.signal: no signal 'Angel' in MOTOROLA; allowed: Angle"),
    (('rule = "xor"', 'rule = "nor"'), "command.checksum.rule: unknown checksum rule 'nor'; allowed: sum, xor"),
    (('rule = "xor"', 'rule = "autosar-2"'), "command.checksum.data_ids: missing"),
    (("last = 14", "last = 99"), "command.counter: start 0, step 1, last 99"),
    (("ratio = 15.0, pos", 'unit = "furlong", pos'), "command.angle.unit: unknown unit 'furlong' of Angle"),
    (("ratio = 15.0, pos", "ratio = 0, pos"), "command.angle: Angle cannot carry it"),
    (("ratio = 15.0, pos", 'ratio = "much", pos'), "command.angle.ratio: Expected `float`, got `str`"),
    (("cycle_ms = 20", "cycle_ms = 1"), "feedback[0].cycle_ms: 1 ms; allowed: >= 10 ms"),
    (("ACTIVE = [3, 4]", "BUSY = [3]"), "feedback[0].state.values: unknown state 'BUSY'"),
    (('angle = { signal = "Angle"', 'curvature = { signal = "Angle"'), None),
    (("[[feedback]]", "[identifiers]\nVEH_DYN = 0x120\n[[feedback]]"), "0x120 is both STEER_CMD and VEH_DYN"),
    (("[[feedback]]", "[identifiers]\nSPEED = 5\n[[feedback]]"), "identifiers.SPEED: none of our messages"),
    (("[[feedback]]", "[limits]\nrate = -1.0\n[[feedback]]"), "limits.rate: -1.0; allowed: a finite number > 0"),
])  # fmt: skip
def test_what_does_not_fit_is_named(bus, change, words):
    if words is None:
        bus(MOTOROLA.replace(*change).replace('positive = "right" }', 'unit = "1/m" }'))
        return
    assert change[0] in MOTOROLA
    with pytest.raises(InputError) as caught:
        bus(MOTOROLA.replace(*change))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_our_own_messages_may_move(bus):
    described = bus(MOTOROLA + "\n[identifiers]\nVEH_DYN = 0x601\n")
    assert described.messages["VEH_DYN"].frame_id == 0x601
    assert described.databases[0].get_message_by_frame_id(0x601).name == "VEH_DYN"


def test_a_mapping_file_without_a_database(tmp_path):
    (tmp_path / "a.toml").write_text(MOTOROLA)
    with pytest.raises(InputError, match="names no database; allowed: a file, or --dbc FILE"):
        mapped_bus(str(tmp_path / "a.toml"))
    with pytest.raises(InputError, match="no such mapping file; allowed: a file, or ford"):
        mapped_bus("nobody")
