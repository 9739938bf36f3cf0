"""ROS 1 bags read without their index: for bags that were cut off, never closed, or have a wrong index.

Follows the description of the bag format 2.0 (wiki.ros.org/Bags/Format/2.0): the file is a row of records, each a
header of ``name=value`` fields and data; messages and connections lie in chunks, which stand alone. So every whole
chunk can be read, whatever became of the index behind it.
"""

import os
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from pfslam_viz.recordings.unpacking import unpack_bz2, unpack_lz4

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_LENGTH = struct.Struct("<I")
_INDEX_ENTRY = 12  # bytes: a time and an offset
_LONGEST_HEADER = 1 << 20  # bytes; definitions of messages lie in the data


class RecordError(Exception):
    """Bytes that are no record of a bag."""


@dataclass(slots=True)
class BagConnection:
    """One publisher of a topic: ``msgtype`` as ``package/msg/Type``, ``digest`` its MD5, ``definition`` its text."""

    id: int
    topic: str
    msgtype: str
    digest: str
    definition: str
    msgcount: int = 0


class RecordReader:
    """The connections and messages of a bag, found by walking its records from the start.

    ``start_time`` and ``end_time`` are receive times in ns (0 without messages); ``damaged`` says that the file ends
    within a record, or holds bytes that are none.
    """

    def __init__(self, path: Path) -> None:
        """Walk through the file once. Raises RecordError when it is no ROS bag 2.0, OSError when unreadable."""
        self.path = path
        self.damaged = False
        self.start_time, self.end_time = 0, 0
        self._known: dict[int, BagConnection] = {}
        for connection, time, _ in self._walk():
            connection.msgcount += 1
            self.start_time = min(self.start_time or time, time)
            self.end_time = max(self.end_time, time)
        self.connections = list(self._known.values())

    def messages(self, connections: Collection[BagConnection]) -> Iterator[tuple[BagConnection, int, bytes]]:
        """Connection, receive time in ns and raw bytes of every message of these, in the order of the file."""
        wanted = {connection.id for connection in connections}
        return (message for message in self._walk() if message[0].id in wanted)

    def _walk(self) -> Iterator[tuple[BagConnection, int, bytes]]:
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordError("not a ROS bag of version 2.0")
            try:
                while (record := _read_record(file)) is not None:
                    header, data, whole = record
                    self.damaged |= not whole
                    if _op(header) == _CHUNK:
                        yield from self._chunk(header, data, whole)
            except (RecordError, struct.error, KeyError):
                self.damaged = True

    def _chunk(self, header: dict[str, bytes], data: bytes, whole: bool) -> Iterator[tuple[BagConnection, int, bytes]]:
        """The messages of a chunk, up to where it is damaged."""
        try:
            yield from self._records(_decompress(header, data, whole))
        except (RecordError, struct.error, KeyError):
            self.damaged = True

    def _records(self, data: bytes) -> Iterator[tuple[BagConnection, int, bytes]]:
        at = 0
        while at + 4 <= len(data):
            header, at = _fields(data, at)
            if at + 4 > len(data):
                return
            (length,) = _LENGTH.unpack_from(data, at)
            body, at = data[at + 4 : at + 4 + length], at + 4 + length
            if len(body) < length:
                return
            if _op(header) == _CONNECTION:
                self._connect(header, body)
            elif _op(header) == _MESSAGE:
                connection = self._known.get(_LENGTH.unpack(header["conn"])[0])
                seconds, nanoseconds = struct.unpack("<II", header["time"])
                if connection is not None:
                    yield connection, seconds * 10**9 + nanoseconds, body

    def _connect(self, header: dict[str, bytes], data: bytes) -> None:
        (number,) = _LENGTH.unpack(header["conn"])
        if number in self._known:
            return
        about, _ = _fields(_LENGTH.pack(len(data)) + data, 0)
        package, _, kind = _text(about, "type").partition("/")
        topic = "/" + "/".join(part for part in _text(header, "topic").split("/") if part)
        self._known[number] = BagConnection(
            number, topic, f"{package}/msg/{kind}", _text(about, "md5sum"), _text(about, "message_definition")
        )


def _read_record(file: BinaryIO) -> tuple[dict[str, bytes], bytes, bool] | None:
    """A record's header, its data (of chunks only) and whether it is whole; None at the end of the file."""
    length = file.read(4)
    if not length:
        return None
    (size,) = _LENGTH.unpack(length)
    if size > _LONGEST_HEADER:
        raise RecordError("no header")
    header, _ = _fields(length + file.read(size), 0)
    (size,) = _LENGTH.unpack(file.read(4))
    if _op(header) == _CHUNK:
        left = os.fstat(file.fileno()).st_size - file.tell()
        data = file.read(min(size, left))  # a damaged size may be of gigabytes, which would be set aside first
        return header, data, len(data) == size
    if _op(header) == _INDEX:  # bags of 2010 state another length than they have
        size = _INDEX_ENTRY * int(_LENGTH.unpack(header["count"])[0])
    elif _op(header) not in (_HEADER, _CHUNK_INFO, _CONNECTION):
        raise RecordError("no record")
    file.seek(size, 1)
    return header, b"", True


def _fields(data: bytes, at: int) -> tuple[dict[str, bytes], int]:
    """The ``name=value`` fields of the header at ``at``, and where it ends."""
    (length,) = _LENGTH.unpack_from(data, at)
    at, end = at + 4, at + 4 + length
    if end > len(data):
        raise RecordError("header cut off")
    fields = {}
    while at < end:
        (size,) = _LENGTH.unpack_from(data, at)
        name, equals, value = data[at + 4 : at + 4 + size].partition(b"=")
        at += 4 + size
        if not equals or at > end:
            raise RecordError("no field")
        fields[name.decode("latin-1")] = value
    return fields, end


def _op(header: dict[str, bytes]) -> int:
    return header.get("op", b"\0")[0]


def _text(fields: dict[str, bytes], name: str) -> str:
    return fields.get(name, b"").decode("utf-8", "replace")


def _decompress(header: dict[str, bytes], data: bytes, whole: bool) -> bytes:
    """A chunk's records; of one that is cut off what is there, if it is not compressed."""
    kind = _text(header, "compression")
    if kind == "none":
        return data
    if not whole:
        return b""
    try:
        if kind == "bz2":
            return unpack_bz2(data)
        if kind == "lz4":
            return unpack_lz4(data)
    except (OSError, ValueError, EOFError, RuntimeError):
        raise RecordError("damaged chunk") from None
    raise RecordError(f"chunks compressed by {kind}")
