import struct
import tracemalloc
from pathlib import Path

import pytest

from pfslam_viz.recordings.ros_records import MAGIC, RecordError, RecordReader


def record(data: bytes, **fields: bytes) -> bytes:
    """A record as the format 2.0 describes it: header's length, its fields, data's length, data."""
    parts = [f"{name}=".encode() + value for name, value in fields.items()]
    header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def number(value: int) -> bytes:
    return struct.pack("<I", value)


def connection(conn: int, topic: str, kind: str) -> bytes:
    inner = record(b"", topic=topic.encode(), type=kind.encode(), md5sum=b"abc", message_definition=b"int8 x\n")
    length = struct.unpack("<I", inner[:4])[0]
    return record(inner[4 : 4 + length], op=b"\x07", conn=number(conn), topic=topic.encode())


def message(conn: int, seconds: int, data: bytes) -> bytes:
    return record(data, op=b"\x02", conn=number(conn), time=struct.pack("<II", seconds, 7))


def bag(*chunks: bytes, compression: bytes = b"none", wrong: bool = False) -> bytes:
    """Chunks, each with an index record of two entries behind it, whose length may be wrong as in bags of 2010."""
    out = MAGIC + record(b" " * 50, op=b"\x03", index_pos=bytes(8), conn_count=number(2), chunk_count=number(1))
    for chunk in chunks:
        out += record(chunk, op=b"\x05", compression=compression, size=number(len(chunk)))
        index = record(bytes(24), op=b"\x04", ver=number(1), conn=number(0), count=number(2))
        at = len(index) - 24 - 4
        out += index[:at] + number(40) + index[at + 4 :] if wrong else index
    return out + connection(0, "/scan", "sensor_msgs/LaserScan")


FIRST = connection(0, "/scan", "sensor_msgs/LaserScan") + message(0, 5, b"uno") + message(0, 6, b"two")
SECOND = connection(1, "//odom/", "nav_msgs/Odometry") + message(1, 8, b"three") + message(0, 7, b"four")


def read(path: Path, data: bytes) -> tuple[RecordReader, list[tuple[str, int, bytes]]]:
    path.write_bytes(data)
    reader = RecordReader(path)
    return reader, [(c.topic, time, raw) for c, time, raw in reader.messages(reader.connections)]


ALL = [
    ("/scan", 5_000_000_007, b"uno"),
    ("/scan", 6_000_000_007, b"two"),
    ("/odom", 8_000_000_007, b"three"),
    ("/scan", 7_000_000_007, b"four"),
]


@pytest.mark.parametrize("wrong", [False, True])
def test_all_messages(tmp_path: Path, wrong: bool) -> None:
    reader, messages = read(tmp_path / "a.bag", bag(FIRST, SECOND, wrong=wrong))
    assert messages == ALL
    assert not reader.damaged
    assert (reader.start_time, reader.end_time) == (5_000_000_007, 8_000_000_007)
    told = [(c.topic, c.msgtype, c.digest, c.definition, c.msgcount) for c in reader.connections]
    assert told == [
        ("/scan", "sensor_msgs/msg/LaserScan", "abc", "int8 x\n", 3),
        ("/odom", "nav_msgs/msg/Odometry", "abc", "int8 x\n", 1),
    ]
    only = [raw for _, _, raw in reader.messages(reader.connections[1:])]
    assert only == [b"three"]


def test_compressed_chunks(tmp_path: Path) -> None:
    import bz2

    frame = pytest.importorskip("lz4.frame", reason="comes with rosbags")
    for name, compress in (("bz2", bz2.compress), ("lz4", frame.compress)):
        data = bag(compress(FIRST), compress(SECOND), compression=name.encode())
        assert read(tmp_path / f"{name}.bag", data)[1] == ALL
        # Cut within the second chunk: the first stands alone.
        reader, messages = read(tmp_path / f"{name}_cut.bag", data[: data.index(compress(SECOND)) + 20])
        assert (messages, reader.damaged) == (ALL[:2], True)


def test_cut_anywhere_it_gives_the_messages_that_are_whole(tmp_path: Path) -> None:
    data = bag(FIRST, SECOND)
    ends = [data.index(raw) + len(raw) for raw in (b"uno", b"two", b"three", b"four")]
    for length in range(len(MAGIC), len(data), 7):
        _, messages = read(tmp_path / "cut.bag", data[:length])
        assert messages == ALL[: sum(end <= length for end in ends)]


def test_a_damaged_chunk_between_others(tmp_path: Path) -> None:
    import bz2

    damaged = bytearray(bz2.compress(SECOND))
    damaged[-12:] = bytes(12)
    reader, messages = read(tmp_path / "a.bag", bag(*map(bz2.compress, [FIRST]), compression=b"bz2"))
    assert (messages, reader.damaged) == (ALL[:2], False)
    data = bag(bytes(damaged), bz2.compress(FIRST), compression=b"bz2")
    reader, messages = read(tmp_path / "b.bag", data)
    assert (messages, reader.damaged) == (ALL[:2], True)


def test_garbage_behind_the_chunks(tmp_path: Path) -> None:
    reader, messages = read(tmp_path / "a.bag", bag(FIRST) + b"\xff" * 100)
    assert (messages, reader.damaged) == (ALL[:2], True)


def test_no_bag(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(b"#ROSBAG V1.2\n")
    with pytest.raises(RecordError, match=r"version 2\.0"):
        RecordReader(path)


def test_a_damaged_size_sets_no_memory_aside(tmp_path: Path) -> None:
    """The only chunk claims to hold 4 GB; what is there is read, and no more."""
    whole = bag(FIRST)
    at = whole.index(FIRST) - 4
    tracemalloc.start()
    try:
        reader, messages = read(tmp_path / "a.bag", whole[:at] + number(2**32 - 1) + whole[at + 4 :])
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()
    assert messages[:2] == ALL[:2]
    assert reader.damaged
