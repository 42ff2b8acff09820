"""`sidestep can map FILE`: a mapping file for somebody else's database, proposed from names and units."""

import re
from collections.abc import Callable, Iterable
from pathlib import Path

from cantools.database.can import Database, Message, Signal

from sidestep.controller.can_port.codec.database import messages
from sidestep.controller.can_port.codec.mapped import UNITS
from sidestep.controller.can_port.codec.messages import STEER_CMD
from sidestep.controller.can_port.protection.checksums import RULES
from sidestep.plant_models.errors import InputError

_COUNTER = re.compile(r"count|cnt|ctr|alive|rolling|sqc|msgc", re.I)
_CHECKSUM = re.compile(r"check|crc|chk|csum|(^|_)cs$|parity", re.I)
_ENABLE = re.compile(r"enab|reques|(^|_)req|rq$|activ|_type$|controltype|status|(^|_)en$", re.I)
_ASKED = re.compile(r"cmd|command|req|desired|target|control|ctrl|(^|_)set|lka|lta|hca|lateral", re.I)
_TOLD = re.compile(r"stat|rpt|report|sens|actual|measur|feedback|eps|(^|_)sas|lwi|esp|info", re.I)
_ANGLES, _CURVATURES = ("rad", "deg", "degree", "degrees", "°"), ("1/m", "1/meter", "rad/m")
_STEER = re.compile(r"steer|(^|_)str|angle|angl|lka|lta|wheel", re.I)
_NOT_STEER = re.compile(
    r"torque|tq|trq|rate|speed|offset|brake|pedal|pitch|roll_|latit|longit|head|yaw|slope|light", re.I
)
_CURVATURE = re.compile(r"curv|crv", re.I)
_ASIDE = re.compile(r"hand|hapt|vib|alert|warn|lamp|hold|clear|overr|sound|fault|err", re.I)
_SIGN = re.compile(r"sign|_vz$|direction", re.I)
_WHEEL_RANGE = 100.0  # degrees from which on an angle is that of the steering wheel
_RATIO = 15.0


def proposed(database: Database, path: Path) -> str:
    """Text of a mapping file, with what else there would be and what is to be checked as comments.

    Args:
        database: As `load_database` reads it.
        path: Its file.

    Raises:
        InputError: Nothing in it looks like steering.
    """
    found = sorted(_commands(database.messages), key=lambda each: -each[0])
    if not found or found[0][0] <= 0:
        raise InputError(str(path), "has no signal that looks like steering", "names or units of angle or curvature")
    _, message, signal = found[0]
    others = [f"{m.name}.{s.name}" for _, m, s in found[1:6]]
    lines = [
        "# Proposed by names and units alone: check every line against the maker's description.",
        f"# Others that might steer: {', '.join(others) or 'none'}.",
        f"# A checksum needs its rule, one of: {', '.join(RULES)}.",
        f'name = "{path.stem}"',
        f'dbc = "{path.name}"',
        "",
        *_command(message, signal),
        *_feedback(database.messages, message),
        *_identifiers(database),
    ]
    return "\n".join(lines) + "\n"


def _identifiers(database: Database) -> list[str]:
    """Free identifiers for those of ours that the database has, too."""
    theirs = {message.frame_id for message in database.messages}
    ours = messages()
    taken = {name: message for name, message in ours.items() if message.frame_id in theirs and name != STEER_CMD.name}
    free = (number for number in range(0x6A0, 0x7FF) if number not in theirs)
    lines = [f"{name} = 0x{next(free):X}  # 0x{message.frame_id:X} is taken" for name, message in taken.items()]
    return ["", "[identifiers]", *lines] if lines else []


def _commands(messages: Iterable[Message]) -> Iterable[tuple[float, Message, Signal]]:
    for message in messages:
        for signal in message.signals:
            score = _steers(signal)
            if score > 0.0:
                asked = 2.0 * bool(_ASKED.search(message.name)) + 2.0 * bool(_ASKED.search(signal.name))
                told = 3.0 * bool(_TOLD.search(message.name)) + 1.0 * bool(_TOLD.search(signal.name))
                guarded = bool(_first(message, _CHECKSUM, signal)) + bool(_first(message, _COUNTER, signal))
                switched = 1.5 * bool(_enable(message, signal))
                yield score + asked - told + 0.5 * guarded + switched, message, signal


def _steers(signal: Signal) -> float:
    unit = (signal.unit or "").strip().lower()
    others = any(pattern.search(signal.name) for pattern in (_NOT_STEER, _COUNTER, _CHECKSUM))
    if signal.is_float or signal.length < 8 or others:
        return 0.0
    if _CURVATURE.search(signal.name):
        return 3.0 + 2.0 * (unit in _CURVATURES)
    if unit in _ANGLES or not unit:
        return 3.0 * bool(_STEER.search(signal.name)) + 1.0 * (unit in _ANGLES) * bool(_STEER.search(signal.name))
    return 0.0


def _first(message: Message, pattern: re.Pattern[str], but: Signal) -> Signal | None:
    return next((s for s in message.signals if s is not but and pattern.search(s.name)), None)


def _enable(message: Message, but: Signal) -> Signal | None:
    small = [s for s in message.signals if s is not but and s.length <= 4 and _ENABLE.search(s.name)]
    return min(small, key=lambda s: (bool(_ASIDE.search(s.name)), s.length), default=None)


def _command(message: Message, signal: Signal) -> list[str]:
    lines = ["[command]", f'message = "{message.name}"']
    if not message.cycle_time:
        lines.append("cycle_ms = 10  # the database does not say")
    if _CURVATURE.search(signal.name):
        parts = f'signal = "{signal.name}"{_unit(signal, "1/m")}{_sign(message, signal)}'
        lines.append(f"curvature = {{ {parts} }}  # to the left?")
    else:
        lines.append(_angle("angle", message, signal))
    if switch := _enable(message, signal):
        lines.append(f'enable = [{{ signal = "{switch.name}", on = 1, off = 0 }}]{_choices(switch)}')
    return lines + _protection(message, signal)


def _protection(message: Message, signal: Signal) -> list[str]:
    lines = []
    if counter := _first(message, _COUNTER, signal):
        lines.append(f'counter = {{ signal = "{counter.name}" }}')
    if checksum := _first(message, _CHECKSUM, signal):
        lines.append(f'# checksum = {{ signal = "{checksum.name}", rule = "sum" }}')
    return lines


def _feedback(messages: Iterable[Message], command: Message) -> list[str]:
    back = [message for message in messages if message is not command]
    speeds = ("m/s", "km/h", "kph", "mph")
    wanted: tuple[tuple[str, Callable[[Message, Signal], float]], ...] = (
        ("angle", lambda m, s: _steers(s) * (bool(_TOLD.search(m.name)) - 0.5 * bool(_ASKED.search(m.name)))),
        ("speed", lambda _, s: _named(s, r"veh.*(spd|speed|vel)|^speed$|(spd|speed).*veh", speeds)),
        ("yaw_rate", lambda _, s: _named(s, r"yaw.*(rate|vel|spd)|gier|^yaw$", ("deg/s", "rad/s", "°/s"))),
    )
    tables: dict[str, tuple[Message, Signal, list[str]]] = {}
    for key, score in wanted:
        best = max(((score(m, s), m, s) for m in back for s in m.signals), key=lambda each: each[0], default=None)
        if best is None or best[0] <= 0.0:
            continue
        _, message, signal = best
        plain = f'{key} = {{ signal = "{signal.name}"{_unit(signal, "deg/s" if key == "yaw_rate" else "km/h")} }}'
        line = _angle(key, message, signal) if key == "angle" else plain
        tables.setdefault(message.name, (message, signal, []))[2].append(line)
    lines = []
    for message, signal, given in tables.values():
        cycle = [] if message.cycle_time else ["cycle_ms = 10  # the database does not say"]
        table = ["", "[[feedback]]", f'message = "{message.name}"', *cycle, *given]
        lines += table + _protection(message, signal)
    return lines


def _named(signal: Signal, pattern: str, units: tuple[str, ...]) -> float:
    named = bool(re.search(pattern, signal.name, re.I)) and signal.length >= 8 and not signal.is_float
    return named * (1.0 + ((signal.unit or "").strip().lower() in units))


def _angle(key: str, message: Message, signal: Signal) -> str:
    factor = UNITS.get((signal.unit or "").strip().lower() or "deg", 1.0)
    highest = signal.offset + signal.scale * (1 << signal.length - signal.is_signed)
    wheel = max(abs(highest), abs(signal.offset)) / factor * UNITS["deg"] > _WHEEL_RANGE
    ratio = f", ratio = {_RATIO:g}" if wheel else ""
    remark = "of the steering wheel, by its range: the ratio of your car? " if wheel else ""
    parts = f'signal = "{signal.name}"{_unit(signal, "deg")}{ratio}, positive = "left"{_sign(message, signal)}'
    return f"{key} = {{ {parts} }}  # {remark}to the left?"


def _sign(message: Message, signal: Signal) -> str:
    """Where the sign of a magnitude is."""
    if signal.is_signed or signal.offset < 0.0 or signal.scale < 0.0:
        return ""
    bits = [s for s in message.signals if s.length == 1 and _SIGN.search(s.name)]
    bit = next((s for s in bits if s.name.lower().startswith(signal.name.lower())), bits[0] if bits else None)
    return f', sign = {{ signal = "{bit.name}" }}' if bit else ""


def _unit(signal: Signal, otherwise: str) -> str:
    return "" if (signal.unit or "").strip().lower() in UNITS and signal.unit else f', unit = "{otherwise}"'


def _choices(signal: Signal) -> str:
    if not signal.choices:
        return ""
    return "  # " + ", ".join(f"{number} {name}" for number, name in sorted(signal.choices.items()))
