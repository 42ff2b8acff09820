"""Reading .blf where python-can's reader hangs or keeps silent: objects of size 0, files cut short, missing objects."""

import struct
import zlib
from collections.abc import Generator, Iterator

import can
from can.io.blf import (
    LOG_CONTAINER,
    LOG_CONTAINER_STRUCT,
    NO_COMPRESSION,
    OBJ_HEADER_BASE_STRUCT,
    ZLIB_DEFLATE,
    BLFParseError,
    BLFReader,
)

_HEAD = OBJ_HEADER_BASE_STRUCT.size
_SMALLEST = _HEAD + 16  # an object without anything in it
_MOST_BYTES = 64 << 20  # of a container, when unpacked; writers fill them with 128 KiB


def _unpacked(packed: bytes) -> bytes:
    worker = zlib.decompressobj()
    data = worker.decompress(packed, _MOST_BYTES)
    if worker.unconsumed_tail:
        raise BLFParseError(f"a container that unpacks to more than {_MOST_BYTES} bytes")
    if not worker.eof:
        raise zlib.error("incomplete stream")
    return data


class CarefulBlfReader(BLFReader):
    """python-can's reader with every size checked.

    Attributes:
        objects: How many have been seen, in containers or beside them.
    """

    objects = 0

    def __iter__(self) -> Generator[can.Message, None, None]:
        """Frames, up to the first object that cannot be right.

        Raises:
            BLFParseError: There is one, with its place.
        """
        while True:
            place = self.file.tell()
            head = self.file.read(_HEAD)
            if not head:
                break
            yield from self._outer(head, place)
        if self.object_count > self.objects:
            raise BLFParseError(f"ends after {self.objects} of {self.object_count} objects")

    def _outer(self, head: bytes, place: int) -> Iterator[can.Message]:
        if len(head) < _HEAD:
            raise BLFParseError(f"cut short at byte {place}")
        signature, _, _, size, kind = OBJ_HEADER_BASE_STRUCT.unpack(head)
        if signature != b"LOBJ" or size < _HEAD:
            raise BLFParseError(f"no object of any size at byte {place}")
        content = self.file.read(size - _HEAD)
        if len(content) < size - _HEAD:
            raise BLFParseError(f"cut short in the object at byte {place}")
        self.file.read(size % 4)
        if kind != LOG_CONTAINER:
            self.objects += 1
            return
        try:
            method, _ = LOG_CONTAINER_STRUCT.unpack_from(content)
            packed = content[LOG_CONTAINER_STRUCT.size :]
            data = packed if method == NO_COMPRESSION else _unpacked(packed) if method == ZLIB_DEFLATE else None
        except (struct.error, zlib.error) as error:
            raise BLFParseError(f"damaged container at byte {place}: {error}") from error
        if data is None:
            raise BLFParseError(f"unknown packing {method} at byte {place}")
        self._count(self._tail + data, place)
        yield from self._parse_container(data)

    def _count(self, data: bytes, place: int) -> None:
        """Count the whole objects in a container; the reader behind would turn round for ever at one of size 0."""
        at = 0
        while (found := data.find(b"LOBJ", at, at + 8)) >= 0 and found + _HEAD <= len(data):
            size = OBJ_HEADER_BASE_STRUCT.unpack_from(data, found)[3]
            if size < _SMALLEST:
                raise BLFParseError(f"object of size {size} in the container at byte {place}")
            if found + size > len(data):
                return
            self.objects += 1
            at = found + size
