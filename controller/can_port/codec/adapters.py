"""Steering commands in formats of others: pure encoders and decoders, nothing is sent from here.

    Tesla DAS_steeringControl 0x488   steering-wheel angle, 0.1 deg, positive to the right; type 1 follows it
    Ford LateralMotionControl 0x3D3   path curvature, 2e-5 1/m, positive to the left; mode 1 follows it; path angle,
                                      path offset and curvature rate stay at their raw zeros
    PACMod3 STEERING_CMD 0x12C        steering-wheel angle and rate, 1 mrad and 1 mrad/s, positive to the left

Every bit, step, offset and sign was compared with these:

    Tesla   commaai/opendbc: 6|15@0+ (0.1,-1638.35), type 23|2@0+, counter 19|4@0+, checksum 31|8@0+; teslacan.py (sign,
            checksum). Later firmware reads a third bit into the type, which stays 0 here, as teslacan.py sends it to
            the earlier one.
    Ford    commaai/opendbc: safety/modes/ford.h (bytes, raw zeros, 50000 steps per 1/m; compared with yaw rate over
            speed without a change of sign), car/ford/fordcan.py (mode, ranges).
    PACMod  astuff/pacmod_dbc: as_pacmod.dbc (15|16@0- and 31|16@0+, 0.001; 5 bytes; counterclockwise is positive);
            the driver astuff/pacmod3 fills the frame up to 8 bytes, and so does this one.

Out of range saturates; a value that is not finite, or enable = False, gives the frame that asks for nothing.
"""

from math import degrees, isfinite, radians
from typing import NamedTuple

TESLA_ID, FORD_ID, PACMOD_ID = 0x488, 0x3D3, 0x12C

_TESLA_OFFSET = -1638.35  # deg
_FORD_IDLE_RATE, _FORD_IDLE_ANGLE, _FORD_IDLE_OFFSET = 4096, 1000, 512  # raw zeros of what is not used
_FORD_OFFSET, _FORD_STEP, _FORD_HIGHEST = -0.02, 2e-5, 2047


class WheelAngle(NamedTuple):
    """A steering-wheel angle that is asked for.

    Attributes:
        angle: Positive to the left, in [rad].
        enable: Whether it is to be followed.
        rate: Largest rate, in [rad/s]; 0 where the format has none.
    """

    angle: float
    enable: bool
    rate: float = 0.0


class PathCurvature(NamedTuple):
    """A path curvature that is asked for.

    Attributes:
        curvature: Positive to the left, in [1/m].
        enable: Whether it is to be followed.
    """

    curvature: float
    enable: bool


def encode_tesla(angle: float, enable: bool, counter: int) -> bytes:
    """DAS_steeringControl: angle of the steering wheel, in [rad], positive to the left."""
    enable = enable and isfinite(angle)
    raw = _clip(-degrees(angle) if enable else 0.0, _TESLA_OFFSET, 0.1, 0x7FFF)
    data = bytes([raw >> 8, raw & 0xFF, enable << 6 | counter & 0x0F])
    return data + bytes([_tesla_checksum(data)])


def decode_tesla(data: bytes) -> WheelAngle | None:
    """The angle of a frame; None if length or checksum do not fit."""
    if len(data) != 4 or data[3] != _tesla_checksum(data[:3]):
        return None
    raw = (data[0] & 0x7F) << 8 | data[1]
    return WheelAngle(-radians(raw * 0.1 + _TESLA_OFFSET), data[2] >> 6 == 1)


def _tesla_checksum(data: bytes) -> int:
    return (sum(data) + (TESLA_ID >> 8) + (TESLA_ID & 0xFF)) & 0xFF


def encode_ford(curvature: float, enable: bool) -> bytes:
    """LateralMotionControl: path curvature, in [1/m], positive to the left."""
    enable = enable and isfinite(curvature)
    raw = _clip(curvature if enable else 0.0, _FORD_OFFSET, _FORD_STEP, _FORD_HIGHEST)
    word = raw << 53 | _FORD_IDLE_RATE << 40 | _FORD_IDLE_ANGLE << 29 | enable << 26 | _FORD_IDLE_OFFSET << 14
    return word.to_bytes(8, "big")


def decode_ford(data: bytes) -> PathCurvature | None:
    """The curvature of a frame; None if the length does not fit."""
    if len(data) != 8:
        return None
    word = int.from_bytes(data, "big")
    return PathCurvature((word >> 53) * _FORD_STEP + _FORD_OFFSET, word >> 26 & 0x7 == 1)


def encode_pacmod(angle: float, rate: float, enable: bool) -> bytes:
    """STEERING_CMD: angle of the steering wheel, in [rad], positive to the left, and its rate, in [rad/s]."""
    enable = enable and isfinite(angle) and isfinite(rate)
    position = _clip(angle if enable else 0.0, -32.768, 1e-3, 0xFFFF) - 0x8000
    speed = _clip(rate if enable else 0.0, 0.0, 1e-3, 0xFFFF)
    return bytes([enable]) + position.to_bytes(2, "big", signed=True) + speed.to_bytes(2, "big") + bytes(3)


def decode_pacmod(data: bytes) -> WheelAngle | None:
    """The angle of a frame of 5 or 8 bytes; None if the length does not fit."""
    if len(data) not in (5, 8):
        return None
    position = int.from_bytes(data[1:3], "big", signed=True)
    return WheelAngle(position * 1e-3, bool(data[0] & 1), int.from_bytes(data[3:5], "big") * 1e-3)


def _clip(value: float, offset: float, step: float, highest: int) -> int:
    """Raw number of a physical value, at the nearer limit if it is out of range."""
    return round(min(max((value - offset) / step, 0.0), highest))
