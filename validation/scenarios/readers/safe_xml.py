"""XML from outside: no document types, no entities, bounded in size, depth and number of elements."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, NoReturn
from xml.parsers import expat

from sidestep.plant_models.documents import file_bytes
from sidestep.plant_models.errors import InputError

MAX_ELEMENTS, MAX_DEPTH = 3_000_000, 100


def read_xml(file: Path) -> ET.Element:
    """The root element of a file.

    Raises:
        InputError: It cannot be read, is too large or too deep, is no XML, or declares a document type or entities.
    """
    return xml_root(file_bytes(file), str(file))


def xml_root(text: bytes, label: str) -> ET.Element:
    """The root element of XML, which errors call `label`.

    Raises:
        InputError: As `read_xml`.
    """
    builder = _Builder(label)
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = builder.refused
    parser.EntityDeclHandler = builder.refused
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.tree.data
    try:
        parser.Parse(text, True)
        return builder.tree.close()
    except (expat.ExpatError, LookupError, ValueError, AssertionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(label, f"is no XML ({error})") from error


class _Builder:
    def __init__(self, where: str) -> None:
        self.where, self.tree, self.depth, self.count = where, ET.TreeBuilder(), 0, 0

    def refused(self, *_: Any) -> NoReturn:
        raise InputError(self.where, "declares a document type or an entity", "XML without <!DOCTYPE ...>")

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self.depth, self.count = self.depth + 1, self.count + 1
        if self.depth > MAX_DEPTH or self.count > MAX_ELEMENTS:
            raise InputError(self.where, "is too deep or has too many elements", f"{MAX_DEPTH} deep, {MAX_ELEMENTS}")
        self.tree.start(name, attributes)

    def end(self, name: str) -> None:
        self.depth -= 1
        self.tree.end(name)


def number(text: str | None, where: str) -> float:
    """A finite number of an attribute or element.

    Raises:
        InputError: It is none.
    """
    try:
        value = float(text or "")
    except ValueError as error:
        raise InputError(where, f"{text!r} is not a number") from error
    if not abs(value) <= 1e9:
        raise InputError(where, f"{text!r}", "a finite number up to 1e9")
    return value
