"""What the frames mean: typed records to bytes and back, without any I/O.

All of it works with every protection: hand over `message` from `database.messages(protection)`.

Every `encode_*` returns a protected frame, saturates what is out of range and never raises on a number.
Every `decode_*` takes a frame that an `e2e.Receiver` accepted and never raises either.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import isfinite, nan
from typing import NamedTuple, get_args

from sidestep.controller.can_port.codec.database import CYCLE, BusMessage, Protection, messages
from sidestep.controller.can_port.protection.e2e_state import E2EState
from sidestep.plant_models.signals import Status, SteeringCommand

STEER_CMD = messages()["STEER_CMD"]
DRIVE_CMD = messages()["DRIVE_CMD"]
STEER_STATUS = messages()["STEER_STATUS"]
CTRL_STATUS = messages()["CTRL_STATUS"]

MAX_ANGLE = STEER_CMD.highest("SteerCmd_Angle")
"""Largest steering angle that STEER_CMD can carry, in [rad]."""

MAX_RATE_LIMIT = STEER_CMD.highest("SteerCmd_RateLimit")
"""Largest steering rate limit that STEER_CMD can carry, in [rad/s]."""

ANSWERS = 63
"""A command names the sample that it answers modulo this; 63 says "not known"."""

_STATUSES = tuple(Status)  # faster than Status(number); two bits, four names


class SteerMode(IntEnum):
    """Mode of the controller (value table of SteerCmd_Mode); an unknown number is a fault."""

    OFF = 0
    STANDBY = 1
    ANGLE = 2
    FAULT = 7

    @classmethod
    def _missing_(cls, value: object) -> "SteerMode":
        return cls.FAULT


class ActuatorState(IntEnum):
    """State of the steering actuator (value table of SteerStatus_State); an unknown number is a fault."""

    INIT = 0
    STANDBY = 1
    ACTIVE = 2
    HOLD = 3
    RAMP_TO_ZERO = 4
    FAULT = 5

    @classmethod
    def _missing_(cls, value: object) -> "ActuatorState":
        return cls.FAULT


class QpStatus(IntEnum):
    """Outcome of a quadratic programme (value table of CtrlStatus_QpStatus); an unknown number is a failure."""

    SOLVED = 0
    MAX_ITERATIONS = 1
    PRIMAL_INFEASIBLE = 2
    DUAL_INFEASIBLE = 3
    NUMERICS = 4
    NOT_RUN = 5

    @classmethod
    def _missing_(cls, value: object) -> "QpStatus":
        return cls.NUMERICS


class SteerFrame(NamedTuple):
    """A decoded STEER_CMD.

    Attributes:
        command: The command; its angle is 0 unless enabled. Its acceleration is not given, unless somebody else's
            message carries one.
        enable: Whether the steering may follow the angle.
        rate_limit: Largest road-wheel rate the controller reckons with, in [rad/s].
        plausible: Whether `encode_steer_command` can have made it.
        answers: Number of the sample that it answers, modulo `ANSWERS`; None if it does not say.
    """

    command: SteeringCommand
    enable: bool
    rate_limit: float
    plausible: bool = True
    answers: int | None = None


@dataclass(frozen=True, slots=True)
class SteerStatus:
    """What the steering actuator reports.

    Attributes:
        state: State of the actuator.
        angle: Realised road-wheel angle, in [rad].
        rate: Realised road-wheel rate, in [rad/s].
        e2e_state: State of the protection of the received command.
        lost: Commands lost since start.
    """

    state: ActuatorState
    angle: float
    rate: float
    e2e_state: E2EState
    lost: int


@dataclass(frozen=True, slots=True)
class ControllerStatus:
    """What the controller reports about its last step.

    Attributes:
        qp_status: Outcome of the quadratic programme.
        status: How far the command can be trusted.
        mode: Mode of the controller.
        solve_time: Time of the whole step, in [s].
        slack: Largest corridor slack, in [m].
        iterations: Iterations of the solver.
    """

    qp_status: QpStatus
    status: Status
    mode: SteerMode
    solve_time: float
    slack: float
    iterations: int


def encode_steer_command(
    command: SteeringCommand,
    counter: int,
    enable: bool = True,
    rate_limit: float = MAX_RATE_LIMIT,
    message: BusMessage = STEER_CMD,
    answers: int | None = None,
) -> bytes:
    """STEER_CMD frame of a command.

    Args:
        command: What to send; if a number in it is not finite the frame says enable = 0, angle 0, FAULT.
        counter: Alive counter.
        enable: Whether the steering may follow the angle; if not, the angle goes out as 0.
        rate_limit: Largest road-wheel rate the controller reckons with, in [rad/s].
        message: STEER_CMD in the protection to use.
        answers: Number of the sample that it answers; None if that is not known.
    """
    return message.encode(
        {
            "SteerCmd_Mode": SteerMode.ANGLE if enable else SteerMode.STANDBY,
            "SteerCmd_Enable": enable,
            "SteerCmd_Angle": command.steer_angle if enable else 0.0,
            "SteerCmd_RateLimit": rate_limit,
            "SteerCmd_TargetSpeed": command.target_speed,
            "DriveCmd_Acceleration": command.acceleration,  # where somebody else's message has a place for it
            "SteerCmd_Status": command.status,
            "SteerCmd_Answers": CYCLE * (ANSWERS if answers is None else answers % ANSWERS),
        },
        counter,
    )


def decode_steer_command(data: bytes | bytearray, time: float, message: BusMessage = STEER_CMD) -> SteerFrame:
    """Command of a STEER_CMD frame.

    A frame whose mode is not ANGLE, or whose angle lies outside its range, counts as not enabled. It is implausible
    if mode and enable contradict each other, or if an angle is given that is out of range or not enabled.

    Args:
        data: Checked frame.
        time: Time of reception, in [s].
        message: STEER_CMD in the protection in use.
    """
    values = message.decode(data)
    angle = values["SteerCmd_Angle"]
    asked, ready = values["SteerCmd_Enable"] == 1, values["SteerCmd_Mode"] == SteerMode.ANGLE
    enable = asked and ready and abs(angle) <= MAX_ANGLE
    plausible = enable or (angle == 0.0 and not asked and not ready)
    status = _STATUSES[int(values["SteerCmd_Status"])]
    command = SteeringCommand(
        time, angle if enable else 0.0, values["SteerCmd_TargetSpeed"], status,
        acceleration=values.get("DriveCmd_Acceleration", nan) if enable else nan,
    )  # fmt: skip
    answers = round(values["SteerCmd_Answers"] / CYCLE)
    return SteerFrame(
        command, enable, values["SteerCmd_RateLimit"], plausible, None if answers == ANSWERS else answers
    )  # fmt: skip


def drive_message(steer: BusMessage) -> BusMessage | None:
    """DRIVE_CMD in the protection of a STEER_CMD of ours; None beside somebody else's message."""
    for protection in get_args(Protection):
        ours = messages(protection)
        if ours[STEER_CMD.name] is steer:
            return ours[DRIVE_CMD.name]
    return None


def encode_drive_command(
    command: SteeringCommand, counter: int, enable: bool = True, message: BusMessage = DRIVE_CMD
) -> bytes:
    """DRIVE_CMD frame of a command; without an acceleration, or one that is not finite, it says enable = 0.

    Args:
        command: What to send.
        counter: Alive counter: that of the STEER_CMD of the same command.
        enable: Whether the acceleration may be realised.
        message: DRIVE_CMD in the protection to use.
    """
    given = enable and isfinite(command.acceleration)
    values = {"DriveCmd_Enable": given, "DriveCmd_Acceleration": command.acceleration if given else 0.0}
    return message.encode(values, counter)


def decode_drive_command(data: bytes | bytearray, message: BusMessage = DRIVE_CMD) -> float:
    """Acceleration of a checked DRIVE_CMD frame, in [m/s^2]; NaN if it is not to be realised."""
    values = message.decode(data)
    return values["DriveCmd_Acceleration"] if values["DriveCmd_Enable"] == 1 else nan


def encode_steer_status(status: SteerStatus, counter: int, message: BusMessage = STEER_STATUS) -> bytes:
    """STEER_STATUS frame."""
    return message.encode(steer_status_values(status), counter)


def steer_status_values(status: SteerStatus) -> dict[str, float]:
    """Signals of STEER_STATUS."""
    return {
        "SteerStatus_State": status.state,
        "SteerStatus_Angle": status.angle,
        "SteerStatus_Rate": status.rate,
        "SteerStatus_E2EState": status.e2e_state,
        "SteerStatus_LostCount": status.lost,
    }


def decode_steer_status(data: bytes | bytearray, message: BusMessage = STEER_STATUS) -> SteerStatus:
    """Record of a checked STEER_STATUS frame."""
    values = message.decode(data)
    return SteerStatus(
        state=ActuatorState(int(values["SteerStatus_State"])),
        angle=values["SteerStatus_Angle"],
        rate=values["SteerStatus_Rate"],
        e2e_state=E2EState(int(values["SteerStatus_E2EState"])),
        lost=int(values["SteerStatus_LostCount"]),
    )


def encode_controller_status(status: ControllerStatus, counter: int, message: BusMessage = CTRL_STATUS) -> bytes:
    """CTRL_STATUS frame."""
    return message.encode(
        {
            "CtrlStatus_QpStatus": status.qp_status,
            "CtrlStatus_Status": status.status,
            "CtrlStatus_Mode": status.mode,
            "CtrlStatus_SolveTime": status.solve_time,
            "CtrlStatus_Slack": status.slack,
            "CtrlStatus_Iterations": status.iterations,
        },
        counter,
    )


def decode_controller_status(data: bytes | bytearray, message: BusMessage = CTRL_STATUS) -> ControllerStatus:
    """Record of a checked CTRL_STATUS frame."""
    values = message.decode(data)
    return ControllerStatus(
        qp_status=QpStatus(int(values["CtrlStatus_QpStatus"])),
        status=Status(int(values["CtrlStatus_Status"])),
        mode=SteerMode(int(values["CtrlStatus_Mode"])),
        solve_time=values["CtrlStatus_SolveTime"],
        slack=values["CtrlStatus_Slack"],
        iterations=int(values["CtrlStatus_Iterations"]),
    )
