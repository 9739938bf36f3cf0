"""A CARMEN log taken apart into its messages. Nothing here knows what the numbers are for."""

import io
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.carmen_layouts import FrontLaser, LaserReading, RawLaser, RobotLaser, Scans
from pfslam_viz.recordings.carmen_numbers import leading_numbers

Array = NDArray[np.float64]

_LAYOUTS: dict[bytes, FrontLaser | RobotLaser] = {
    b"FLASER": FrontLaser(),
    b"ROBOTLASER1": RobotLaser(),
    b"LASER_READING": LaserReading(),
    b"RAWLASER1": RawLaser(),
    b"RLASER": FrontLaser(),
    b"REARLASER": FrontLaser(),
    b"ROBOTLASER2": RobotLaser(),
    b"RAWLASER2": RawLaser(),
}
# Which types to look at first: those with odometry in the line, then the same scanner without, then the one behind.
_TIERS = ((b"FLASER", b"ROBOTLASER1", b"LASER_READING"), (b"RAWLASER1",), tuple(_LAYOUTS)[4:])
REAR = frozenset(kind.decode() for kind in _TIERS[2])

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_LASER_KIND = re.compile(rb"^[A-Z][A-Z_]*(?:LASER|LIDAR)[A-Z_]*\d*$")
_DECIMAL_COMMA = re.compile(rb"\d,\d")


@dataclass(frozen=True, slots=True)
class Messages:
    """What a log holds.

    Attributes:
        scans: by message type, of the types that were looked at; types without a readable line are left out.
        odometry: (m, 4) x, y, theta, stamp of the ODOM lines.
        parameters: PARAMs that are numbers.
        words: PARAMs that are not.
        unreadable: how many lines are broken.
        not_read: types of scans that were not looked at, with how many lines they have.
        decimal_commas: whether broken lines of scans or odometry have numbers such as 1,5.
    """

    scans: dict[str, Scans]
    odometry: Array
    parameters: dict[str, float]
    words: dict[str, str]
    unreadable: int
    not_read: dict[str, int]
    decimal_commas: bool


def plain_text(data: bytes) -> bytes:
    """A log's text in single bytes: without a byte order mark, UTF-16 (as PowerShell writes it) as UTF-8, no tabs."""
    if data.startswith(_BYTE_ORDER_MARK):
        data = data[len(_BYTE_ORDER_MARK) :]
    elif data.startswith(_UTF16):
        data = data.decode("utf-16", errors="replace").encode()
    return data.replace(b"\t", b" ") if b"\t" in data else data


def read_messages(text: bytes) -> Messages:
    """Take a log apart, as :func:`plain_text` gives it. Lines of other types are skipped; broken ones are counted."""
    lines: dict[bytes, list[bytes]] = {kind: [] for kind in (*_LAYOUTS, b"ODOM", b"PARAM")}
    for line in _lines(text):
        kind, _, rest = line.partition(b" ")
        if not kind:  # indented
            kind, _, rest = line.lstrip().partition(b" ")
        if kind in lines:
            lines[kind].append(rest)
    unreadable = 0
    scans: dict[str, Scans] = {}
    broken: list[bytes] = []
    chosen = _tier({kind: len(lines[kind]) for kind in _LAYOUTS})
    for kind in chosen:
        rows = _LAYOUTS[kind].rows(lines[kind])
        kept = [row for row in rows if row is not None]
        unreadable += len(rows) - len(kept)
        if kept:
            scans[kind.decode()] = _LAYOUTS[kind].to_scans(kept)
        elif rows:
            broken += lines[kind][:10]
    odometry = [row for row in leading_numbers(lines[b"ODOM"], _odometry_length) if row is not None]
    unreadable += len(lines[b"ODOM"]) - len(odometry)
    if not odometry:
        broken += lines[b"ODOM"][:10]
    table = np.array([row[[0, 1, 2, -1]] for row in odometry]).reshape(-1, 4)
    numbers, words = _parameters(lines[b"PARAM"])
    not_read = {kind.decode(): len(lines[kind]) for kind in _LAYOUTS if kind not in chosen and lines[kind]}
    if not scans:
        not_read |= _laser_kinds(text)
    commas = any(_DECIMAL_COMMA.search(line) for line in broken)
    return Messages(scans, table, numbers, words, unreadable, not_read, commas)


def _lines(text: bytes) -> Iterator[bytes]:
    """The lines one by one, since a list of all of them takes many times their room where they are short."""
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return (line.rstrip(b"\n") for line in io.BytesIO(text))


def _tier(count: dict[bytes, int]) -> tuple[bytes, ...]:
    """The message types to take scans from.

    The front laser's with odometry in the line, unless its RAWLASER1 messages are more than ten times as many; what the
    laser behind saw only if there is nothing else.
    """
    with_odometry, raw = (max(count[kind] for kind in tier) for tier in _TIERS[:2])
    if with_odometry * 10 < raw:
        return _TIERS[1]
    return _TIERS[0] if with_odometry else _TIERS[2]


def _laser_kinds(text: bytes) -> dict[str, int]:
    """The types of lines that are called like a laser's but that no layout is known of."""
    kinds = Counter(line.split(None, 1)[0] for line in _lines(text) if line.strip())
    return {kind.decode(): n for kind, n in kinds.items() if kind not in _LAYOUTS and _LASER_KIND.match(kind)}


def _odometry_length(row: Array) -> int:
    """``x y theta tv rv accel ipc_timestamp``, or GMapping's ``x y theta timestamp``."""
    return 4 if len(row) == 4 else 7


def _parameters(lines: Iterable[bytes]) -> tuple[dict[str, float], dict[str, str]]:
    numbers: dict[str, float] = {}
    words: dict[str, str] = {}
    for line in lines:
        parts = [part.decode(errors="replace") for part in line.split(None, 2)[:2]]
        if len(parts) < 2:
            continue
        try:
            value = float(parts[1])
        except ValueError:
            words[parts[0]] = parts[1]
            continue
        if math.isfinite(value):
            numbers[parts[0]] = value
    return numbers, words
