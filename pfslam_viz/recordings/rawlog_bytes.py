"""Values of MRPT's binary serialisation, taken one after the other: numbers, texts, times, matrices and poses.

An object is its class's name behind a length byte with the top bit set (before MRPT 0.5.5 a 32-bit length), a version,
its fields in little-endian order, and the byte 0x88. Layouts by the serializeFrom functions of MRPT 2, which read all
versions there have been.
"""

import re
import struct

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_END = 0x88
# 100 ns ticks from 1601-01-01 to 1970-01-01.
_TICKS_TO_1970 = 116_444_736_000_000_000
_HEADER = re.compile(rb"([\x80-\xff]|[\x01-\x7f]\0\0\0)((?:mrpt::\w{1,20}::)?C[A-Z]\w{2,60})")


class Malformed(Exception):
    """The bytes are no such object, or one of a version that is not known."""


class Bytes:
    """A place in the data, from which values are taken one after the other."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data = data
        self.at = at

    def take(self, layout: str) -> tuple[float, ...]:
        """Numbers by a layout of :mod:`struct`, little-endian."""
        try:
            values = struct.unpack_from("<" + layout, self.data, self.at)
        except struct.error:
            raise Malformed("cut short") from None
        self.at += struct.calcsize("<" + layout)
        return values

    def whole(self, layout: str = "I") -> int:
        """One whole number."""
        return int(self.take(layout)[0])

    def array(self, count: int, kind: str) -> NDArray[np.generic]:
        """``count`` numbers of a NumPy type."""
        size = np.dtype(kind).itemsize * count
        if self.at + size > len(self.data):
            raise Malformed("cut short")
        values = np.frombuffer(self.data, dtype=kind, count=count, offset=self.at)
        self.at += size
        return values

    def text(self) -> str:
        """A string behind its length."""
        size = self.whole()
        if size > 4096:
            raise Malformed("no text")
        return bytes(self.array(size, "u1")).decode(errors="replace")

    def stamp(self) -> float | None:
        """A time in s since 1970, None for MRPT's invalid one."""
        ticks = self.whole("Q")
        return (ticks - _TICKS_TO_1970) / 1e7 if ticks > _TICKS_TO_1970 // 1000 else None

    def header(self) -> tuple[str, int, bool]:
        """An object's class without namespace, version, and whether an end byte follows it."""
        match = _HEADER.match(self.data, self.at)
        if match is None or match[1][0] & 0x7F > len(match[2]):
            raise Malformed("no object")
        old = len(match[1]) == 4
        name = match[2][: match[1][0] & 0x7F]
        self.at = match.start(2) + len(name)
        version = self.whole("i") if old else self.whole("B")
        return name.decode().rpartition("::")[2], version, not old

    def end(self, has_end: bool) -> None:
        """The end byte of an object."""
        if has_end and self.whole("B") != _END:
            raise Malformed("no end")


def first_class(data: bytes) -> str | None:
    """The class of the object that the data begin with, None if they do not begin with one."""
    source = Bytes(data, 0)
    try:
        name, version, _ = source.header()
    except Malformed:
        return None
    return name if 0 <= version < 50 else None


def pose_2d(source: Bytes) -> Array:
    """A CPose2D: x, y, heading (3,)."""
    name, version, has_end = source.header()
    if name != "CPose2D" or version not in (0, 1):
        raise Malformed("no CPose2D")
    pose = np.array(source.take("fff" if version == 0 else "ddd"))
    source.end(has_end)
    if not np.isfinite(pose).all():
        raise Malformed("not finite")
    return pose


def pose_3d(source: Bytes) -> tuple[float, float, float, Array]:
    """A CPose3D: x, y, z and the rotation matrix (3, 3)."""
    name, version, has_end = source.header()
    if name != "CPose3D" or not 0 <= version <= 3:
        raise Malformed("no CPose3D")
    if version < 2:
        whole = matrix(source)
        if whole.shape != (4, 4):
            raise Malformed("no pose")
        x, y, z = whole[:3, 3]
        rotation = whole[:3, :3]
    elif version == 2:
        x, y, z, w, i, j, k = source.take("7d")
        rotation = np.array(
            [
                [w * w + i * i - j * j - k * k, 2 * (i * j - w * k), 2 * (i * k + w * j)],
                [2 * (i * j + w * k), w * w - i * i + j * j - k * k, 2 * (j * k - w * i)],
                [2 * (i * k - w * j), 2 * (j * k + w * i), w * w - i * i - j * j + k * k],
            ]
        )
    else:
        x, y, z, *rest = source.take("12d")
        rotation = np.array(rest).reshape(3, 3)
    source.end(has_end)
    if not np.isfinite([x, y, z]).all() or not np.isfinite(rotation).all():
        raise Malformed("not finite")
    return float(x), float(y), float(z), rotation


def matrix(source: Bytes) -> Array:
    """A matrix of doubles (CMatrixD) or floats."""
    name, _, has_end = source.header()
    if not name.startswith("CMatrix"):
        raise Malformed("no matrix")
    rows, columns = source.whole(), source.whole()
    if rows > 64 or columns > 64:
        raise Malformed("no matrix")
    values = source.array(rows * columns, "<f8" if name.startswith("CMatrixD") else "<f4")
    source.end(has_end)
    return values.astype(np.float64).reshape(rows, columns)
