"""Foreign steering frames: known vectors, both sides of every limit, and what is not finite."""

import math

import cantools.database
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.controller.can_port.codec.adapters import (
    decode_ford,
    decode_pacmod,
    decode_tesla,
    encode_ford,
    encode_pacmod,
    encode_tesla,
)

SOURCES = """VERSION ""
BU_: X
BO_ 1160 Tesla: 4 X
 SG_ Haptic : 7|1@0+ (1,0) [0|0] "" X
 SG_ Angle : 6|15@0+ (0.1,-1638.35) [0|0] "deg" X
 SG_ Type : 23|2@0+ (1,0) [0|0] "" X
 SG_ Counter : 19|4@0+ (1,0) [0|0] "" X
 SG_ Checksum : 31|8@0+ (1,0) [0|0] "" X
BO_ 979 Ford: 8 X
 SG_ Curvature : 7|11@0+ (2E-005,-0.02) [0|0] "1/m" X
 SG_ Rate : 12|13@0+ (2.5E-007,-0.001024) [0|0] "1/m^2" X
 SG_ Angle : 31|11@0+ (0.0005,-0.5) [0|0] "rad" X
 SG_ Request : 36|3@0+ (1,0) [0|0] "" X
 SG_ Offset : 47|10@0+ (0.01,-5.12) [0|0] "m" X
BO_ 300 PACMod: 8 X
 SG_ Enable : 0|1@0+ (1,0) [0|1] "" X
 SG_ IgnoreOverrides : 1|1@0+ (1,0) [0|1] "" X
 SG_ ClearOverride : 2|1@0+ (1,0) [0|1] "" X
 SG_ Position : 15|16@0- (0.001,0) [-32.768|32.767] "rad" X
 SG_ Rate : 31|16@0+ (0.001,0) [0|65.535] "rad/s" X
"""
NOT_FINITE = (math.nan, math.inf, -math.inf)


def test_tesla_vector():
    """9.95 deg to the right is raw 16483 = 0x4063; type 1 and counter 5 are 0x45; the checksum adds 0x04 and 0x88."""
    assert encode_tesla(math.radians(-9.95), True, 5).hex() == f"406345{(0x40 + 0x63 + 0x45 + 0x8C) % 256:02x}"


def test_ford_vector():
    """0.01 1/m to the left is raw 1500; what is not used stands at its zero: 4096, 1000 and 512."""
    data = encode_ford(0.01, True)
    assert (data[0] << 3 | data[1] >> 5, (data[1] & 0x1F) << 8 | data[2]) == (1500, 4096)
    assert (data[3] << 3 | data[4] >> 5, data[5] << 2 | data[6] >> 6, data[4] >> 2 & 7) == (1000, 512, 1)
    assert data.hex() == "bb90007d04800000"


def test_pacmod_vector():
    assert encode_pacmod(-0.5, 3.3, True).hex() == "01fe0c0ce4000000"
    assert encode_pacmod(0.0, 0.0, False).hex() == "0000000000000000"
    assert decode_pacmod(bytes.fromhex("01fe0c0ce4")) == decode_pacmod(bytes.fromhex("01fe0c0ce4000000"))


def test_bits_are_those_of_the_sources():
    """What the sources named in adapters.py say, as a database for cantools."""
    dbc = cantools.database.load_string(SOURCES, "dbc")
    tesla = dbc.decode_message(0x488, encode_tesla(0.5, True, 9))
    assert tesla["Angle"] == pytest.approx(-math.degrees(0.5), abs=0.0501)
    assert (tesla["Type"], tesla["Counter"], tesla["Haptic"]) == (1, 9, 0)
    ford = dbc.decode_message(0x3D3, encode_ford(-0.0123, True))
    assert ford["Curvature"] == pytest.approx(-0.0123, abs=1.001e-5)
    assert ford["Request"] == 1
    assert [ford[name] for name in ("Rate", "Angle", "Offset")] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    pacmod = dbc.decode_message(0x12C, encode_pacmod(-1.234, 2.5, True))
    assert (pacmod["Position"], pacmod["Rate"]) == pytest.approx((-1.234, 2.5))
    assert (pacmod["Enable"], pacmod["IgnoreOverrides"], pacmod["ClearOverride"]) == (1, 0, 0)


@given(st.floats(-28.0, 28.0), st.booleans(), st.integers(0, 100))
def test_tesla_round_trip(angle, enable, counter):
    data = encode_tesla(angle, enable, counter)
    got = decode_tesla(data)
    assert data[2] & 0x0F == counter % 16
    assert got.enable is enable
    assert got.angle == pytest.approx(angle if enable else 0.0, abs=math.radians(0.0501))


@given(st.floats(-0.02, 0.02094), st.booleans())
def test_ford_round_trip(curvature, enable):
    got = decode_ford(encode_ford(curvature, enable))
    assert got.enable is enable
    assert got.curvature == pytest.approx(curvature if enable else 0.0, abs=1.001e-5)


@given(st.floats(-32.768, 32.767), st.floats(0.0, 65.535), st.booleans())
def test_pacmod_round_trip(angle, rate, enable):
    got = decode_pacmod(encode_pacmod(angle, rate, enable))
    assert got.enable is enable
    assert (got.angle, got.rate) == pytest.approx((angle, rate) if enable else (0.0, 0.0), abs=5.001e-4)


@pytest.mark.parametrize("beyond", [1.0, 10.0, 1e9])
def test_out_of_range_stops_at_the_limit_on_both_sides(beyond):
    for sign in (1.0, -1.0):
        assert decode_tesla(encode_tesla(sign * (28.6 + beyond), True, 0)).angle == pytest.approx(
            sign * 28.595, abs=2e-3
        )
        assert decode_pacmod(encode_pacmod(sign * (32.768 + beyond), 1.0, True)).angle == pytest.approx(
            sign * 32.768, abs=1.1e-3
        )
    assert decode_ford(encode_ford(0.021 + beyond, True)).curvature == pytest.approx(0.02094)
    assert decode_ford(encode_ford(-0.02 - beyond, True)).curvature == pytest.approx(-0.02)
    assert decode_pacmod(encode_pacmod(0.0, 65.0 + beyond, True)).rate == pytest.approx(65.535, abs=0.54)
    assert decode_pacmod(encode_pacmod(0.0, -beyond, True)).rate == 0.0


@pytest.mark.parametrize("bad", NOT_FINITE)
def test_what_is_not_finite_asks_for_nothing(bad):
    assert encode_tesla(bad, True, 3) == encode_tesla(0.0, False, 3)
    assert encode_ford(bad, True) == encode_ford(0.0, False)
    assert encode_pacmod(bad, 1.0, True) == encode_pacmod(1.0, bad, True) == encode_pacmod(0.0, 0.0, False)


def test_damaged_frames_are_refused():
    data = encode_tesla(0.1, True, 3)
    for bit in range(32):
        assert decode_tesla((int.from_bytes(data, "big") ^ 1 << bit).to_bytes(4, "big")) is None
    assert decode_tesla(data + b"\0") is decode_ford(bytes(7)) is decode_pacmod(bytes(9)) is None
