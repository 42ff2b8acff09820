"""BUS.toml: which messages and signals of somebody else's database carry the steering. See docs/can.md."""

from math import inf
from pathlib import Path
from typing import Literal

import msgspec

from sidestep.plant_models.documents import read_toml
from sidestep.plant_models.errors import InputError


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class SignBit(_Table, frozen=True, kw_only=True):
    """A signal that holds the sign of another.

    Attributes:
        signal: Its name.
        negative: Its raw value where the other is to the right.
    """

    signal: str
    negative: int = 1


class Quantity(_Table, frozen=True, kw_only=True):
    """A signal that carries a number: `physical = ratio * value + offset`, in the signal's unit.

    Attributes:
        signal: Its name.
        unit: deg, rad, km/h, ...; empty for what the database says.
        ratio: What one of ours is of theirs, such as the steering ratio.
        offset: In the signal's unit.
        positive: The side to which the signal counts up.
        sign: Where the sign is, if the signal has none.
    """

    signal: str
    unit: str = ""
    ratio: float = 1.0
    offset: float = 0.0
    positive: Literal["left", "right"] = "left"
    sign: SignBit | None = None


class Switch(_Table, frozen=True, kw_only=True):
    """A signal that says whether the command is to be followed.

    Attributes:
        signal: Its name.
        on, off: Its raw values.
    """

    signal: str
    on: int = 1
    off: int = 0


class Counter(_Table, frozen=True, kw_only=True):
    """An alive counter.

    Attributes:
        signal: Its name.
        start: First value.
        step: From one to the next.
        last: The largest; the signal's own if it is not given.
        skip: Values that are left out.
    """

    signal: str
    start: int = 0
    step: int = 1
    last: int | None = None
    skip: tuple[int, ...] = ()


class Checksum(_Table, frozen=True, kw_only=True):
    """A checksum by the name of its rule, see `checksums.RULES`.

    Attributes:
        signal: Its name.
        rule: Name of the rule.
        polynomial, initial, reflect, xor_out: Of a CRC of your own.
        data_id: Of AUTOSAR profiles 1 and 5.
        data_ids: Hexadecimal, one byte for every counter: of profile 2.
    """

    signal: str
    rule: str
    polynomial: int = 0x1D
    initial: int = 0
    reflect: bool = False
    xor_out: int = 0
    data_id: int = 0
    data_ids: str = ""


class States(_Table, frozen=True, kw_only=True):
    """A signal that tells the state of the actuator.

    Attributes:
        signal: Its name.
        values: Raw values by the name of the state (INIT, STANDBY, ACTIVE, HOLD, RAMP_TO_ZERO, FAULT); the first of
            each is what is sent. Others read as FAULT.
    """

    signal: str
    values: dict[str, tuple[int, ...]]


class MappedTable(_Table, frozen=True, kw_only=True):
    """What all messages have.

    Attributes:
        message: Name in the database.
        cycle_ms: Time between two of them, in [ms]; the database's if it is not given, or 10.
        constants: Raw values of signals that stand still, multiplexers among them.
        counter, checksum: Protection.
    """

    message: str
    cycle_ms: float | None = None
    constants: dict[str, int] = msgspec.field(default_factory=dict)
    counter: Counter | None = None
    checksum: Checksum | None = None


class Command(MappedTable, frozen=True, kw_only=True):
    """The message that steers.

    Attributes:
        angle: Road-wheel angle, times the steering ratio where it is that of the steering wheel.
        curvature: Path curvature, instead of the angle.
        wheelbase: Of the car that the curvature is for, in [m].
        rate: Largest rate of the angle.
        speed: Speed to hold.
        acceleration: Wanted now, negative to brake.
        enable: What has to be on for the angle to be followed.
    """

    angle: Quantity | None = None
    curvature: Quantity | None = None
    wheelbase: float | None = None
    rate: Quantity | None = None
    speed: Quantity | None = None
    acceleration: Quantity | None = None
    enable: tuple[Switch, ...] = ()


class Feedback(MappedTable, frozen=True, kw_only=True):
    """A message that comes back.

    Attributes:
        angle, angle_rate: Of the road wheels, as in the command.
        speed, yaw_rate, lateral_acceleration: Of the vehicle.
        state: State of the actuator.
        fault: What is on when the actuator has a fault.
    """

    angle: Quantity | None = None
    angle_rate: Quantity | None = None
    speed: Quantity | None = None
    yaw_rate: Quantity | None = None
    lateral_acceleration: Quantity | None = None
    state: States | None = None
    fault: Switch | None = None


class Limits(_Table, frozen=True, kw_only=True):
    """What the interface lets pass, see `interface`.

    Attributes:
        angle: Largest road-wheel angle, in [rad].
        rate: Largest road-wheel rate, in [rad/s].
        lateral_acceleration, lateral_jerk: Of a slow turn at the speed, in [m/s^2] and [m/s^3].
    """

    angle: float | None = None
    rate: float | None = None
    lateral_acceleration: float | None = None
    lateral_jerk: float | None = None


class BusFile(_Table, frozen=True, kw_only=True):
    """A mapping file.

    Attributes:
        name: In a few words.
        source: Where its facts are from.
        dbc: Database, seen from this file; `--dbc` goes before it.
        command: The message that steers.
        feedback: The messages that come back.
        limits: What the interface lets pass.
        identifiers: Others than in steer.dbc for those of our messages that remain, by name.
    """

    name: str = ""
    source: str = ""
    dbc: str = ""
    command: Command
    feedback: tuple[Feedback, ...] = ()
    limits: Limits = msgspec.field(default_factory=Limits)
    identifiers: dict[str, int] = msgspec.field(default_factory=dict)


def read_bus_file(path: Path) -> BusFile:
    """Read a mapping file.

    Raises:
        InputError: It cannot be read, or a key or value in it cannot be used.
    """
    tables = read_toml(path, "a mapping file, see docs/can.md")
    try:
        file = msgspec.convert(tables, BusFile)
    except msgspec.ValidationError as error:
        words, _, place = str(error).partition(" - at `$")
        raise InputError(f"{path}: {place.strip('.`') or 'file'}", words, "see docs/can.md") from error
    if (file.command.angle is None) == (file.command.curvature is None):
        raise InputError(f"{path}: command", "needs one thing to steer by", "angle or curvature")
    for name in file.limits.__struct_fields__:
        value = getattr(file.limits, name)
        if value is not None and not 0.0 < value < inf:
            raise InputError(f"{path}: limits.{name}", f"{value}", "a finite number > 0")
    return file
