"""The messages of a bus by name: ours, or ours with somebody else's in the place of some of them."""

from dataclasses import dataclass, replace
from pathlib import Path

from cantools.database.can import Database, Message

from sidestep.controller.can_port.codec import mapping as m
from sidestep.controller.can_port.codec.database import (
    CYCLE,
    EXTENDED,
    BusMessage,
    Catalogue,
    Protection,
    load_dbc,
    messages,
)
from sidestep.controller.can_port.codec.foreign import load_database, message_named, signal_named
from sidestep.controller.can_port.codec.mapped import (
    MappedMessage,
    Number,
    as_curvature,
    number_of,
)
from sidestep.controller.can_port.codec.mapped_profile import Field, profile_of
from sidestep.controller.can_port.codec.messages import DRIVE_CMD, STEER_CMD, STEER_STATUS, ActuatorState
from sidestep.controller.can_port.interface import Interface
from sidestep.plant_models.errors import InputError

MAPS = Path(__file__).parents[1] / "maps"
"""The mapping files that come with the package."""

_WHEELBASE = 2.8  # of a car that neither file nor scenario tells, in [m]


@dataclass(frozen=True)
class BusDescription:
    """What travels on a bus.

    Attributes:
        messages: By name.
        databases: Which decode them for people.
        interface: What the way to the actuator lets pass; None for everything.
        remarks: What was not strictly right with somebody else's database.
    """

    messages: Catalogue
    databases: tuple[Database, ...]
    interface: Interface | None = None
    remarks: str = ""


def own_bus(protection: Protection = "P02") -> BusDescription:
    """Our own messages."""
    return BusDescription(messages(protection), (load_dbc(protection),))


def built_in_maps() -> list[str]:
    """Names of the mapping files that come with the package."""
    return sorted(file.stem for file in MAPS.glob("*.toml"))


def map_file(name: str) -> Path:
    """The mapping file that is meant: a file, or one that comes with the package.

    Raises:
        InputError: There is none.
    """
    if Path(name).is_file():
        return Path(name)
    if name in built_in_maps():
        return MAPS / f"{name}.toml"
    raise InputError(name, "no such mapping file", f"a file, or {', '.join(built_in_maps())}")


def mapped_bus(
    name: str, dbc: Path | None = None, protection: Protection = "P02", wheelbase: float | None = None
) -> BusDescription:
    """Our messages with those of a mapping file in their place.

    Args:
        name: Mapping file, or one that comes with the package.
        dbc: Database; None for the one that the file names.
        protection: Of ours that remain.
        wheelbase: Of the car, in [m], where the file does not tell it.

    Raises:
        InputError: File or database cannot be used, or do not fit each other.
    """
    path = map_file(name)
    file = m.read_bus_file(path)
    if dbc is None and not file.dbc:
        raise InputError(f"{path}: dbc", "names no database", "a file, or --dbc FILE")
    database, remarks = load_database(dbc or path.parent / file.dbc)
    catalogue = _moved(protection, file.identifiers, f"{path}: identifiers")
    del catalogue[DRIVE_CMD.name]  # goes with our own STEER_CMD only
    catalogue[STEER_CMD.name] = _command(database, file.command, f"{path}: command", wheelbase)
    for k, table in enumerate(file.feedback):
        message = _feedback(database, table, f"{path}: feedback[{k}]", wheelbase)
        if table.angle:
            catalogue.pop(STEER_STATUS.name, None)
        catalogue[f"feedback[{k}] {message.name}"] = message
    _refuse_twice(catalogue, str(path))
    ours = load_dbc(protection)
    for message in ours.messages:
        message.frame_id = file.identifiers.get(message.name, message.frame_id)
    ours.refresh()
    car = file.command.wheelbase or wheelbase or _WHEELBASE
    interface = Interface(file.limits, car) if file.limits != m.Limits() else None
    return BusDescription(catalogue, (ours, database), interface, remarks)


def _moved(protection: Protection, identifiers: dict[str, int], where: str) -> dict[str, BusMessage]:
    """Our messages, some of them under other identifiers."""
    ours = messages(protection)
    for name, number in identifiers.items():
        if name not in ours:
            raise InputError(f"{where}.{name}", "none of our messages", ", ".join(ours))
        if not 0 <= number <= 0x7FF:
            raise InputError(f"{where}.{name}", f"{number:#x}", "0 to 0x7FF")
    return {name: replace(message, frame_id=identifiers.get(name, message.frame_id)) for name, message in ours.items()}


def _refuse_twice(catalogue: Catalogue, where: str) -> None:
    seen: dict[int, str] = {}
    for name, message in catalogue.items():
        if first := seen.get(message.frame_id):
            raise InputError(where, f"0x{message.frame_id:X} is both {first} and {name}", "[identifiers] for ours")
        seen[message.frame_id] = name


def _command(database: Database, table: m.Command, where: str, wheelbase: float | None) -> MappedMessage:
    message = message_named(database, table.message, f"{where}.message")
    numbers = []
    if table.angle:
        numbers.append(number_of("SteerCmd_Angle", message, table.angle, f"{where}.angle"))
    if table.curvature:
        number = number_of("SteerCmd_Angle", message, table.curvature, f"{where}.curvature")
        numbers.append(as_curvature(number, table.wheelbase or wheelbase or _WHEELBASE))
    if table.rate:
        numbers.append(number_of("SteerCmd_RateLimit", message, table.rate, f"{where}.rate"))
    if table.speed:
        numbers.append(number_of("SteerCmd_TargetSpeed", message, table.speed, f"{where}.speed"))
    if table.acceleration:
        numbers.append(number_of("DriveCmd_Acceleration", message, table.acceleration, f"{where}.acceleration"))
    switches = tuple(_switch(message, each, f"{where}.enable[{k}]") for k, each in enumerate(table.enable))
    return _message(message, table, where, "CTRL", tuple(numbers), switches=switches)


def _feedback(database: Database, table: m.Feedback, where: str, wheelbase: float | None) -> MappedMessage:
    message = message_named(database, table.message, f"{where}.message")
    ours = {"angle": "SteerStatus_Angle", "angle_rate": "SteerStatus_Rate", "speed": "VehDyn_Speed",
            "yaw_rate": "VehDyn_YawRate", "lateral_acceleration": "VehDyn_AccLat"}  # fmt: skip
    given = {key: getattr(table, key) for key in ours if getattr(table, key)}
    numbers = tuple(number_of(ours[key], message, quantity, f"{where}.{key}") for key, quantity in given.items())
    states = fault = None
    if table.state:
        unknown = set(table.state.values) - {state.name for state in ActuatorState}
        if unknown:
            allowed = ", ".join(state.name for state in ActuatorState)
            raise InputError(f"{where}.state.values", f"unknown state {unknown.pop()!r}", allowed)
        signal = signal_named(message, table.state.signal, f"{where}.state.signal")
        values = {int(ActuatorState[name]): numbers for name, numbers in table.state.values.items() if numbers}
        states = Field.of(signal), values
    if table.fault:
        fault = _switch(message, table.fault, f"{where}.fault")
    sender = "EPS" if table.angle or states or fault else "VEH"
    return _message(message, table, where, sender, numbers, states=states, fault=fault)


def _switch(message: Message, switch: m.Switch, where: str) -> tuple[Field, int, int]:
    return Field.of(signal_named(message, switch.signal, f"{where}.signal")), switch.on, switch.off


_LONGEST_CYCLE = 1e4  # ms


def _message(
    message: Message, table: m.MappedTable, where: str, sender: str, numbers: tuple[Number, ...], **more: object
) -> MappedMessage:
    cycle = table.cycle_ms or message.cycle_time or 1e3 * CYCLE
    if not 1e3 * CYCLE <= cycle <= _LONGEST_CYCLE:
        allowed = f">= {1e3 * CYCLE:g} ms, up to {_LONGEST_CYCLE:g} ms"
        raise InputError(f"{where}.cycle_ms", f"{cycle:g} ms", allowed)
    base = bytearray(message.length)
    for signal in message.signals:
        Field.of(signal).put(base, int(signal.raw_initial or 0))
    for name, raw in table.constants.items():
        Field.of(signal_named(message, name, f"{where}.constants")).put(base, raw)
    return MappedMessage(
        name=message.name,
        frame_id=message.frame_id | EXTENDED * message.is_extended_frame,
        length=message.length,
        cycle=1e-3 * cycle,
        profile=profile_of(message, table, where),
        sender=sender,
        is_fd=message.is_fd or message.length > 8,
        base=bytes(base),
        numbers=numbers,
        **more,  # pyright: ignore[reportArgumentType]
    )
