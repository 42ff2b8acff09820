"""Checksums of other makers' messages, by name.

A rule is a function of the identifier, the frame with its checksum bits at 0, the byte that holds the checksum, the
counter, and what the mapping file says beside the name. Sources: AUTOSAR FO PRS_E2EProtocol (profiles 1, 2 and 5), SAE
J1850 for the CRC of that name, and the functions of commaai/opendbc for those that are named after makers; its own
functions are the oracle that they were compared with (docs/can.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

from sidestep.plant_models.errors import InputError


@dataclass(frozen=True)
class Parameters:
    """What a mapping file may say beside the name of a rule.

    Attributes:
        width: Bits of the checksum.
        polynomial, initial, reflect, xor_out: Of a CRC.
        data_id: 16-bit number that enters the CRC of profiles 1 and 5.
        data_ids: One byte for every counter, that of profile 2.
    """

    width: int = 8
    polynomial: int = 0x1D
    initial: int = 0
    reflect: bool = False
    xor_out: int = 0
    data_id: int = 0
    data_ids: bytes = b""


Rule = Callable[[int, bytes, int, int, Parameters], int]


@cache
def crc_table(width: int, polynomial: int, reflect: bool) -> tuple[int, ...]:
    """What a byte makes of a CRC of 8 bits or more that is 0."""
    if reflect:
        mirrored = int(f"{polynomial:0{width}b}"[::-1], 2)
        return tuple(_shifted(byte, lambda crc: crc >> 1 ^ (mirrored if crc & 1 else 0)) for byte in range(256))
    top, mask = 1 << width - 1, (1 << width) - 1
    return tuple(
        _shifted(byte << width - 8, lambda crc: (crc << 1 ^ (polynomial if crc & top else 0)) & mask)
        for byte in range(256)
    )


def _shifted(crc: int, step: Callable[[int], int]) -> int:
    for _ in range(8):
        crc = step(crc)
    return crc


def crc(data: Sequence[int], p: Parameters) -> int:
    """CRC of some bytes."""
    table, value, mask = crc_table(p.width, p.polynomial, p.reflect), p.initial, (1 << p.width) - 1
    for byte in data:
        if p.reflect:
            value = value >> 8 ^ table[(value ^ byte) & 0xFF]
        else:
            value = (value << 8 ^ table[(value >> p.width - 8 ^ byte) & 0xFF]) & mask
    return value ^ p.xor_out


def _others(data: bytes, at: int, count: int = 1) -> bytes:
    return data[:at] + data[at + count :]


def _bytes(number: int) -> list[int]:
    """Bytes of an identifier, the low one first; none for 0."""
    found = []
    while number:
        found.append(number & 0xFF)
        number >>= 8
    return found


def _nibbles(data: Sequence[int]) -> int:
    return sum((byte >> 4) + (byte & 0xF) for byte in data)


def _sum(_: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    return (sum(_others(data, at)) + p.initial) & 0xFF


def _xor(_: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    value = p.initial
    for byte in _others(data, at):
        value ^= byte
    return value


def _crc(_: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    return crc(_others(data, at, p.width // 8), p)


def _with(**fixed: int | bool) -> Rule:
    fixed_parameters = Parameters(**fixed)  # type: ignore[arg-type]
    return lambda frame_id, data, at, counter, _: _crc(frame_id, data, at, counter, fixed_parameters)


def _profile_1(_: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    """Data ID low and high, then the frame (E2E_P01DATAID_BOTH)."""
    return crc([p.data_id & 0xFF, p.data_id >> 8, *_others(data, at)], Parameters(polynomial=0x1D))


def _profile_2(_: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    ids = p.data_ids
    return crc([*_others(data, at), ids[counter % len(ids)]], Parameters(polynomial=0x2F, initial=0xFF, xor_out=0xFF))


def _profile_5(_: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    sixteen = Parameters(width=16, polynomial=0x1021, initial=0xFFFF)
    return crc([*_others(data, at, 2), p.data_id & 0xFF, p.data_id >> 8], sixteen)


def _toyota(frame_id: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    return (len(data) + sum(_bytes(frame_id)) + sum(_others(data, at))) & 0xFF


def _identifier_sum(frame_id: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    return (sum(_bytes(frame_id)) + sum(_others(data, at))) & 0xFF


def _honda(frame_id: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    extended = 3 if frame_id > 0x7FF else 0
    return (8 - _nibbles(_bytes(frame_id)) - _nibbles(data) + extended) & 0xF


def _psa(frame_id: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    return (p.initial - _nibbles(data)) & 0xF


_LENGTHS = {8: 0x5F29, 16: 0x041D, 24: 0x819D, 32: 0x9F5B}


def _hyundai_canfd(frame_id: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    sixteen = Parameters(width=16, polynomial=0x1021)
    return crc([*_others(data, at, 2), frame_id & 0xFF, frame_id >> 8 & 0xFF], sixteen) ^ _LENGTHS.get(len(data), 0)


def _ford_lateral_2(_: int, data: bytes, at: int, counter: int, p: Parameters) -> int:
    """Sum of the signals of LateralMotionControl2, each with its own high byte."""
    signals = (
        data[2] << 3 | data[3] >> 5, data[6] << 3 | data[7] >> 5,
        (data[3] & 0x1F) << 6 | data[4] >> 2, (data[4] & 3) << 8 | data[5],
    )  # fmt: skip
    mode = data[0] >> 4 & 7
    return 0xFF - (mode + counter + sum(signal + (signal >> 8) for signal in signals) & 0xFF)


RULES: dict[str, Rule] = {
    "sum": _sum, "xor": _xor, "crc": _crc,
    "j1850": _with(polynomial=0x1D, initial=0xFF, xor_out=0xFF),
    "autosar-1": _profile_1, "autosar-2": _profile_2, "autosar-5": _profile_5,
    "toyota": _toyota, "tesla": _identifier_sum, "subaru": _identifier_sum, "honda": _honda, "psa": _psa,
    "chrysler": _with(polynomial=0x1D, initial=0xFF, xor_out=0xFF),
    "nissan": _with(polynomial=0x1D, xor_out=0xFF),
    "hyundai-canfd": _hyundai_canfd, "ford-lateral-2": _ford_lateral_2,
}  # fmt: skip
"""Rules by name."""


def rule_named(name: str, where: str) -> Rule:
    """A rule by its name.

    Args:
        name: As in the mapping file.
        where: Place in it, for the error.

    Raises:
        InputError: There is none of that name.
    """
    if name not in RULES:
        raise InputError(where, f"unknown checksum rule {name!r}", ", ".join(RULES))
    return RULES[name]
