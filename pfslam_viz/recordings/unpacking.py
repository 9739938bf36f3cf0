"""How much is unpacked of what somebody else packed: a few kilobytes of .bz2 can hold gigabytes of nothing.

Packed files unpack to at most :data:`SURE` bytes, or to :data:`RATIO` times their own size where that is more, and to
:data:`MOST` in no case. Logs of robots pack by 3 to 20, an archive of constant numbers by 1,000.
"""

import bz2
import gzip
import importlib
import io
import sys
import zlib
from pathlib import Path
from typing import Any, BinaryIO

from pfslam_viz.errors import InputError

SURE = 64 << 20
RATIO = 100
MOST = 2 << 30
LONGEST_LINE = 4 << 20  # bytes; a scan of 100,000 beams has 1 MB
BZIP2, GZIP = b"BZh", b"\x1f\x8b"
_BLOCK = 1 << 20


class TooLarge(ValueError):
    """Something packed unpacks to more than can be meant."""


def allowance(packed: int, sure: int = SURE) -> int:
    """How many bytes may come out of ``packed`` bytes."""
    return min(max(sure, RATIO * packed), MOST)


def read_file(path: Path, lines: bool = False) -> bytes:
    """What a file holds, unpacked by what it is (bzip2, gzip or plain) rather than by what it is called.

    What is written to the file meanwhile is not waited for. With ``lines``, a line of more than :data:`LONGEST_LINE`
    bytes ends it. Raises InputError for a file that is too large, or unpacks to too much; and, with the file's name,
    whatever keeps it from being read.
    """
    try:
        with path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(0)
            start = file.read(3)
            file.seek(0)
            if start.startswith(BZIP2):
                with bz2.BZ2File(file) as unpacked:
                    return _read(unpacked, path, allowance(size), True, lines)
            if start.startswith(GZIP):
                with gzip.GzipFile(fileobj=file) as unpacked:
                    return _read(unpacked, path, allowance(size), True, lines)
            if size > MOST:
                raise InputError(
                    f"{path}: {size / 2**30:.1f} GB are more than can be read ({MOST >> 30} GB); cut it up"
                )
            return _read(file, path, size, False, lines)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise InputError(f"{path}: damaged or only half downloaded; get it again") from None
    except OSError as error:
        if error.errno is None:  # bz2 reports broken data this way
            raise InputError(f"{path}: damaged; get it again") from None
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def _read(file: "BinaryIO | bz2.BZ2File | gzip.GzipFile", path: Path, most: int, packed: bool, lines: bool) -> bytes:
    """At most ``most`` bytes of a file; more of them are an error in what was ``packed``, and left out else."""
    whole, got, line = io.BytesIO(), 0, 0
    while got < most or packed:
        block = file.read(min(_BLOCK, most + 1 - got) if packed else min(_BLOCK, most - got))
        if not block:
            break
        got += len(block)
        if got > most:
            raise InputError(
                f"{path}: unpacks to more than {most >> 20:,} MB, which no recording of its size does; if it is one,"
                " unpack it beforehand"
            )
        if lines:
            end = block.find(b"\n")
            line += len(block) if end < 0 else end
            if line > LONGEST_LINE:
                raise InputError(f"{path}: has a line of more than {LONGEST_LINE >> 20} MB, as no log has")
            if end >= 0:
                line = len(block) - block.rfind(b"\n") - 1
        whole.write(block)
    return whole.getvalue()


def is_plain(path: Path) -> bool:
    """Whether a file holds something that is not packed; False also where it cannot be read."""
    try:
        with path.open("rb") as file:
            start = file.read(3)
    except OSError:
        return False
    return start != b"" and not start.startswith((BZIP2, GZIP))


def unpack_bz2(data: bytes) -> bytes:
    """As :func:`bz2.decompress`, of one stream. Raises TooLarge."""
    return _whole(bz2.BZ2Decompressor(), data)


def unpack_lz4(data: bytes) -> bytes:
    """As ``lz4.frame.decompress``. Raises TooLarge."""
    import lz4.frame  # type: ignore[import-untyped]  # comes with rosbags

    return _whole(lz4.frame.LZ4FrameDecompressor(), data)


def unpack_zstd(data: bytes) -> bytes:
    """As ``zstd.decompress``, of one frame. Raises TooLarge."""
    return _whole(_zstd().ZstdDecompressor(), data)


class _Zstd:
    """What rosbags asks of its module ``zstd``, within limits."""

    decompress = staticmethod(unpack_zstd)

    @staticmethod
    def open(file: BinaryIO, mode: str) -> "_Bounded":
        size = file.seek(0, io.SEEK_END)
        file.seek(0)
        return _Bounded(_zstd().open(file, mode), allowance(size))


class _Bounded:
    """A file that raises TooLarge once more than ``most`` bytes were read from it. A context manager."""

    def __init__(self, file: Any, most: int) -> None:
        self._file, self._left = file, most

    def read(self, size: int = -1) -> bytes:
        block = bytes(self._file.read(min(size, _BLOCK) if size > 0 else _BLOCK))
        self._left -= len(block)
        if self._left < 0:
            raise TooLarge("the file unpacks to more than any bag of its size")
        return block

    def __enter__(self) -> "_Bounded":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def bound_rosbags() -> None:
    """Have rosbags unpack no more than :func:`allowance` lets through: its own functions take what comes."""
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import storage_mcap

    ros1.decompressors.update({"bz2": unpack_bz2, "lz4": unpack_lz4})
    storage_mcap.DECOMPRESSORS.update(
        {"lz4": lambda data, _: unpack_lz4(data), "zstd": lambda data, _: unpack_zstd(data)}
    )
    vars(importlib.import_module("rosbags.rosbag2.reader"))["zstd"] = _Zstd


def _zstd() -> Any:
    name = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"  # the latter comes with rosbags
    return importlib.import_module(name)


def _whole(decompressor: Any, data: bytes) -> bytes:
    most = allowance(len(data))
    unpacked = bytes(decompressor.decompress(data, most + 1))
    if len(unpacked) > most:
        raise TooLarge(f"{len(data):,} bytes unpack to more than {most >> 20:,} MB")
    if not decompressor.eof:
        raise ValueError("packed data end too early")
    return unpacked
