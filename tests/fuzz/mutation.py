"""Damage that knows what it damages: values, entries and nesting of TOML, JSON and XML, cells of tables, bytes of all.

Every file follows from its seed alone. One to four blows each, so that most files get far into a reader.
"""

import json
import random
import re
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

Data = bytes
Blow = Callable[[random.Random, Data], Data]

NUMBERS = (
    "0", "-0.0", "1", "-1", "1e-320", "1e-300", "5e-324", "1e300", "-1e300", "1e308", "1e309", "nan", "inf", "-inf",
    "NaN", "Infinity", "1e18", "-1e18", "1e9", "1e-9", "2147483648", "-2147483649", "9223372036854775807",
    "9223372036854775808", "18446744073709551616", "9" * 400, "9" * 5000, "0x7fffffff", "1_000", "1,5", "٣", "1e", ".",
    "1979-05-27", "1979-05-27T07:32:00Z", "true", "[]", "{}", '""', "null", "0.1", "3.0", "100", "1000000", "-3.7",
)  # fmt: skip
TEXTS = (
    "", " ", "a\nb", "a\n",
    "\x1b[2J\x1b]0;t\x07", "\u202egnp", "\ufeff", "..", ".", "../../x", "/etc/passwd", "/dev/zero",
    "%s%n%x", "$(id)", "<b>", "]]>", "x" * 3000, "\u0000", "a/b", "C:\\x", "😀", "-", "--set", "${1/0}", "${9**9**9}",
    "$a", "NaN", "0", "road", "world", "linear", "mujoco", "none", "x=1", "é", "\ud7ff", "\u2028", "nowhere:factory",
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_QUOTED = re.compile(rb"\"[^\"\n]*\"|>[^<>\n]+<")


def mutated(random_: random.Random, seeds: list[Data], trees: tuple[Blow, ...] = ()) -> Data:
    """A damaged copy of one of the seeds; `trees` are blows that know the format."""
    data = random_.choice(seeds)
    for _ in range(random_.choice((1, 1, 1, 2, 2, 3, 4))):
        blow = random_.choice((*_PLAIN, *(trees * 3)))
        data = blow(random_, data)[: 1 << 20]
    if random_.random() < 0.03:
        data = _spliced(random_, data, random_.choice(seeds))
    return data


def _number(random_: random.Random, data: Data) -> Data:
    return _replaced(random_, data, _NUMBER, lambda old: random_.choice(NUMBERS).encode())


def _nudged(random_: random.Random, data: Data) -> Data:
    def near(old: bytes) -> bytes:
        return repr(float(old) * random_.choice((-1.0, 0.0, 0.5, 2.0, 10.0, 1e3, 1e6, 1e-3, 1e-6))).encode()

    return _replaced(random_, data, _NUMBER, near)


def _text(random_: random.Random, data: Data) -> Data:
    def other(old: bytes) -> bytes:
        return old[:1] + random_.choice(TEXTS).encode() + old[-1:]

    return _replaced(random_, data, _QUOTED, other)


def _replaced(random_: random.Random, data: Data, pattern: re.Pattern[bytes], other: Callable[[bytes], bytes]) -> Data:
    found = list(pattern.finditer(data))
    if not found:
        return data
    place = random_.choice(found)
    return data[: place.start()] + other(place[0]) + data[place.end() :]


def _lines(random_: random.Random, data: Data) -> Data:
    lines = data.split(b"\n")
    i, j = random_.randrange(len(lines)), random_.randrange(len(lines))
    match random_.randrange(6):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines[i])
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i : i + 1] *= random_.choice((2, 50, 300))
        case 4:
            lines[i] = lines[i][: random_.randrange(len(lines[i]) + 1)]
        case _:
            lines = lines[: i + 1]
    return b"\n".join(lines)


def _cells(random_: random.Random, data: Data) -> Data:
    """A cell of a table more, less, quoted or in another place."""
    mark = random_.choice((b",", b";", b" ", b"\t"))
    lines = data.split(b"\n")
    i = random_.randrange(len(lines))
    cells = lines[i].split(mark)
    k = random_.randrange(len(cells))
    cells[k : k + 1] = random_.choice(([], [cells[k]] * 2, [b'"' + cells[k]], [b""], [b"#" + cells[k]], [b"e", b"nan"]))
    lines[i] = mark.join(cells)
    return b"\n".join(lines)


def _bytes(random_: random.Random, data: Data) -> Data:
    result = bytearray(data)
    for _ in range(random_.choice((1, 1, 2, 8, 40))):
        if not result:
            break
        i = random_.randrange(len(result))
        match random_.randrange(4):
            case 0:
                result[i] ^= 1 << random_.randrange(8)
            case 1:
                result[i] = random_.choice((0, 0xFF, 0x7F, 0x80, 10, 13, 34, 91, 123, 60))
            case 2:
                del result[i : i + random_.choice((1, 2, 4, 16))]
            case _:
                result[i:i] = random_.randbytes(random_.choice((1, 2, 4, 8)))
    return bytes(result)


def _sizes(random_: random.Random, data: Data) -> Data:
    """A field of 2, 4 or 8 bytes of a binary file."""
    size = random_.choice((2, 4, 8))
    if len(data) < size:
        return data
    i = random_.randrange(len(data) - size + 1)
    value = random_.choice((0, 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1, len(data)))
    order = random_.choice(("little", "big"))
    return data[:i] + (value % 2 ** (8 * size)).to_bytes(size, order) + data[i + size :]


def _cut(random_: random.Random, data: Data) -> Data:
    return data[: random_.randrange(len(data) + 1)]


def _nested(random_: random.Random, data: Data) -> Data:
    """Brackets or elements in each other, deeper than any stack."""
    depth = random_.choice((3, 70, 1500, 5000))
    begin, end = random_.choice(((b"[", b"]"), (b"{a=", b"}"), (b'{"a":', b"}"), (b"<a>", b"</a>"), (b"(", b")")))
    i = random_.randrange(len(data) + 1)
    return data[:i] + begin * depth + (b"1" if random_.random() < 0.5 else b"") + end * depth + data[i:]


def _spliced(random_: random.Random, data: Data, other: Data) -> Data:
    return data[: random_.randrange(len(data) + 1)] + other[random_.randrange(len(other) + 1) :]


def _coded(random_: random.Random, data: Data) -> Data:
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return data
    return random_.choice((b"\xef\xbb\xbf" + data, text.encode("utf-16"), text.encode("utf-8-sig"), b"\x00" + data,
                           data.replace(b"\n", b"\r\n"), data.replace(b"\n", b"\r")))  # fmt: skip


_PLAIN: tuple[Blow, ...] = (_number, _nudged, _text, _lines, _cells, _bytes, _sizes, _cut, _nested, _coded)


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every container of a tree with a key or index in it."""
    below = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in list(below):
        yield value, key
        yield from _places(inner)


def _any(random_: random.Random) -> Any:
    number = random_.choice(NUMBERS)
    plain = [random_.choice(TEXTS), True, False, [], {}, [[]], [{}], 0, -1, 1.0, 1e300, 1e-300, 10**400, None]
    with suppress(ValueError):
        plain.append(float(number))
    return random_.choice(plain)


def tree_blow(random_: random.Random, tree: Any) -> Any:
    """Change, drop, double, move or add one entry."""
    places = list(_places(tree))
    if not places:
        return _any(random_)
    holder, key = random_.choice(places)
    match random_.randrange(5):
        case 0 | 1:
            holder[key] = _any(random_)
        case 2:
            del holder[key]
        case 3:
            other, name = random_.choice(places)
            holder[key] = json.loads(json.dumps(other[name], default=str)) if _is_there(other, name) else 0
        case _:
            if isinstance(holder, dict):
                holder[random_.choice((*TEXTS[:12], "speed", "type", "name", "unit", "file", "t", "s"))] = _any(random_)
            else:
                holder.extend([holder[key]] * random_.choice((1, 3, 200)))
    return tree


def _is_there(holder: Any, key: Any) -> bool:
    return key in holder if isinstance(holder, dict) else key < len(holder)


def toml_blow(random_: random.Random, data: Data) -> Data:
    """One entry of a TOML file changed; what is none any more stays as it is."""
    try:
        tree = tree_blow(random_, tomllib.loads(data.decode()))
        return _toml(tree).encode(errors="replace") if isinstance(tree, dict) else data
    except (ValueError, RecursionError):
        return data


def json_blow(random_: random.Random, data: Data) -> Data:
    """One entry of a JSON file, or of a line of JSON lines, changed."""
    lines = data.split(b"\n") if data.count(b"\n") > 1 and data.startswith(b'{"') else [data]
    i = random_.randrange(len(lines))
    try:
        lines[i] = json.dumps(tree_blow(random_, json.loads(lines[i]))).encode()
    except (ValueError, RecursionError):
        return data
    return b"\n".join(lines)


def _toml(tables: dict[str, Any]) -> str:
    return "".join(f"{json.dumps(key)} = {_toml_value(value)}\n" for key, value in tables.items())


def _toml_value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(str(key))} = {_toml_value(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_toml_value(inner) for inner in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return "0" if value is None else str(value).lower() if isinstance(value, bool | float) else str(value)


def xml_blow(random_: random.Random, data: Data) -> Data:
    """An element or attribute of an XML file dropped, doubled, moved, or given another value."""
    try:
        root = ET.fromstring(data)
    except (ET.ParseError, ValueError, LookupError):
        return data
    parents = [element for element in root.iter() if len(element)]
    everything = list(root.iter())
    element = random_.choice(everything)
    match random_.randrange(7):
        case 0 | 1 if element.attrib:
            value = random_.choice((*NUMBERS, *TEXTS))
            element.set(random_.choice(list(element.attrib)), _xml_text(value))
        case 2 if element.attrib:
            del element.attrib[random_.choice(list(element.attrib))]
        case 3 if parents:
            parent = random_.choice(parents)
            parent.remove(random_.choice(list(parent)))
        case 4 if parents:
            parent = random_.choice(parents)
            parent.extend([random_.choice(list(parent))] * random_.choice((1, 2, 40)))
        case 5:
            other = random_.choice(everything)
            if element not in other.iter():
                element.append(other)
        case _:
            element.text = _xml_text(random_.choice((*NUMBERS, *TEXTS)))
    try:
        return ET.tostring(root)
    except (RecursionError, ValueError):
        return data


def _xml_text(text: str) -> str:
    return "".join(letter for letter in text if letter >= " " or letter in "\n\t")
