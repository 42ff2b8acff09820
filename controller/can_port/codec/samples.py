"""One sample of the vehicle's motion: its frames, its number on the vehicle's clock, and the state that it is."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import fields
from math import isfinite, pi, remainder

import can

from sidestep.controller.can_port.codec.database import CYCLE, BusMessage, messages
from sidestep.controller.can_port.codec.messages import ANSWERS
from sidestep.plant_models.signals import VehicleState

VEH_DYN, VEH_POS, VEH_HEADING = (messages()[name] for name in ("VEH_DYN", "VEH_POS", "VEH_HEADING"))

VEHICLE_STATE = (VEH_DYN, VEH_POS, VEH_HEADING)
"""The messages that together carry one sample of the vehicle's motion, in the order they are sent."""

SAMPLES = 4095
"""Samples are numbered by the vehicle's clock in cycles, modulo this; the number itself says "not known". A multiple of
`ANSWERS`, so that both wrap together."""

assert SAMPLES % ANSWERS == 0

EXACT_ID = 0x210
"""Identifier of STATE_EXACT, which holds the fields of `VehicleState` as doubles."""

LOG_CHANNEL = 1
"""Channel of frames that are in a log and never were on a bus."""


def sample_number(time: float) -> int:
    """Number of the sample that is taken at `time` of the vehicle's clock, in [s]."""
    return round(time / CYCLE)


def encode_vehicle_state(
    state: VehicleState,
    lateral_acceleration: float,
    counter: int,
    valid: bool = True,
    sample: Sequence[BusMessage] = VEHICLE_STATE,
) -> list[bytes]:
    """Frames of one sample, in the order of `VEHICLE_STATE`.

    The heading goes out wrapped to one turn; the steering angle is STEER_STATUS's.

    Args:
        state: What to send; a frame with a number in it that is not finite says valid = 0. Its time names the sample.
        lateral_acceleration: At the centre of gravity, in [m/s^2].
        counter: Alive counter, the same in all three frames: it ties them together.
        valid: Whether the state is to be used.
        sample: `VEHICLE_STATE` in the protection to use.
    """
    values = (
        {
            "VehDyn_Valid": valid,
            "VehDyn_Speed": state.v_x,
            "VehDyn_YawRate": state.yaw_rate,
            "VehDyn_AccLat": lateral_acceleration,
        },
        {"VehPos_Valid": valid, "VehPos_X": state.x, "VehPos_Y": state.y},
        {
            "VehHeading_Valid": valid,
            "VehHeading_Yaw": _wrap(state.yaw),
            "VehHeading_SpeedLat": state.v_y,
            "VehHeading_Sample": CYCLE * (sample_number(state.time) % SAMPLES if isfinite(state.time) else SAMPLES),
        },
    )
    return [message.encode(of_message, counter) for message, of_message in zip(sample, values, strict=True)]


def decode_vehicle_state(
    frames: Sequence[bytes | bytearray],
    time: float,
    steer_angle: float = 0.0,
    near_yaw: float = 0.0,
    sample: Sequence[BusMessage] = VEHICLE_STATE,
) -> VehicleState | None:
    """State of one sample; None if a frame says that it is not valid.

    Args:
        frames: Checked frames with the same counter, in the order of `VEHICLE_STATE`.
        time: Time of reception, in [s].
        steer_angle: Realised road-wheel angle from STEER_STATUS, in [rad].
        near_yaw: A heading less than half a turn away, such as the last one, in [rad]; it undoes the wrapping.
        sample: `VEHICLE_STATE` in the protection in use.
    """
    values = {"SteerStatus_Angle": steer_angle}
    for message, data in zip(sample, frames, strict=True):
        values |= message.decode(data)
    return vehicle_state(values, time, near_yaw)


def vehicle_state(values: Mapping[str, float], time: float, near_yaw: float) -> VehicleState | None:
    """State of the signals of one sample, by their names in steer.dbc; None if one of them says that it is not valid.

    Args:
        values: Signals of VEH_DYN, VEH_POS, VEH_HEADING and STEER_STATUS.
        time: Of the state, in [s].
        near_yaw: A heading less than half a turn away, in [rad].
    """
    if not (values["VehDyn_Valid"] and values["VehPos_Valid"] and values["VehHeading_Valid"]):
        return None
    return VehicleState(
        time=time,
        x=values["VehPos_X"],
        y=values["VehPos_Y"],
        yaw=near_yaw + _wrap(values["VehHeading_Yaw"] - near_yaw),
        v_x=values["VehDyn_Speed"],
        v_y=values["VehHeading_SpeedLat"],
        yaw_rate=values["VehDyn_YawRate"],
        steer_angle=values["SteerStatus_Angle"],
    )


def exact_frame(state: VehicleState) -> can.Message:
    """STATE_EXACT: the state in full, for logs; on `LOG_CHANNEL`, for it never was on a bus."""
    data = struct.pack("<8d", *(getattr(state, f.name) for f in fields(VehicleState)))
    return can.Message(state.time, EXACT_ID, False, data=data, is_fd=True, channel=LOG_CHANNEL, is_rx=False)


def exact_state(data: bytes | bytearray) -> VehicleState:
    """State of a STATE_EXACT frame."""
    return VehicleState(*struct.unpack("<8d", data))


def _wrap(angle: float) -> float:
    """The same direction within half a turn, in [rad]; what is not finite stays so."""
    return remainder(angle, 2.0 * pi) if isfinite(angle) else angle
