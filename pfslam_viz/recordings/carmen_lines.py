"""The lines of a CARMEN log to arrays. Nothing here knows what the numbers are for."""

import math
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scans:
    """n scans of one message type, in the log's order. Poses are (n, 3): x, y in m, theta in rad.

    Attributes:
        stamps: (n,) s, ipc.
        ranges: n arrays of (beams,) m.
        beams: (n,) how many.
        start: (n,) rad, angle of the first beam.
        resolution: (n,) rad between beams.
        max_range: (n,) m, NaN where not given.
        laser: the laser's pose.
        robot: the robot's pose by raw odometry.
        on_robot: whether ``laser`` and ``robot`` together say where the laser sits.
    """

    stamps: Array
    ranges: list[Array]
    beams: NDArray[np.intp]
    start: Array
    resolution: Array
    max_range: Array
    laser: Array
    robot: Array
    on_robot: bool

    def take(self, kept: NDArray[np.intp]) -> "Scans":
        """The scans of the given indices, in their order."""
        return Scans(
            stamps=self.stamps[kept],
            ranges=[self.ranges[k] for k in kept],
            beams=self.beams[kept],
            start=self.start[kept],
            resolution=self.resolution[kept],
            max_range=self.max_range[kept],
            laser=self.laser[kept],
            robot=self.robot[kept],
            on_robot=self.on_robot,
        )

    def at(self, stamps: Array) -> "Scans":
        """The same scans with other stamps."""
        return replace(self, stamps=stamps)


@dataclass(frozen=True, slots=True)
class Messages:
    """What a log holds: scans by message type, ODOM as (m, 4) x, y, theta, stamp, PARAMs that are numbers."""

    scans: dict[str, Scans]
    odometry: Array
    parameters: dict[str, float]
    unreadable: int


def read_messages(text: bytes) -> Messages:
    """Take a log apart. Lines of other types are skipped; broken ones are counted."""
    lines: dict[bytes, list[bytes]] = {kind: [] for kind in (*_LAYOUTS, b"ODOM", b"PARAM")}
    for line in text.splitlines():
        kind, _, rest = line.partition(b" ")
        if kind in lines:
            lines[kind].append(rest)
    unreadable = 0
    scans = {}
    for kind, layout in _LAYOUTS.items():
        rows = layout.rows(lines[kind])
        kept = [row for row in rows if row is not None]
        unreadable += len(rows) - len(kept)
        scans[kind.decode()] = layout.to_scans(kept)
    odometry = [row for row in _rows(lines[b"ODOM"], _odometry_length) if row is not None]
    unreadable += len(lines[b"ODOM"]) - len(odometry)
    table = np.array([row[[0, 1, 2, -1]] for row in odometry]).reshape(-1, 4)
    return Messages(scans, table, _parameters(lines[b"PARAM"]), unreadable)


def _odometry_length(row: Array) -> int:
    """``x y theta tv rv accel ipc_timestamp``, or GMapping's ``x y theta timestamp``."""
    return 4 if len(row) == 4 else 7


def _parameters(lines: Iterable[bytes]) -> dict[str, float]:
    values = {}
    for line in lines:
        words = line.split()
        try:
            values[words[0].decode()] = float(words[1])
        except (IndexError, ValueError):
            continue  # a parameter that is a word: no use for it here
    return {name: value for name, value in values.items() if math.isfinite(value)}


def _rows(lines: list[bytes], length: Callable[[Array], int]) -> list[Array | None]:
    """The leading numbers of every line, as many as ``length`` (of what is there) asks for; None for broken lines.

    All lines are parsed in one go; only if that fails does each line get its own attempt.
    """
    numbers = [line.rsplit(None, 2)[0] if line.count(b" ") > 2 else line for line in lines]  # less host, logger stamp
    table = _parse(b" ".join(numbers))
    if table is not None:
        rows, at = [], 0
        for _ in lines:
            size = length(table[at:])
            if size <= 0 or at + size > len(table):
                break
            rows.append(table[at : at + size])
            at += size
        if len(rows) == len(lines) and at == len(table):
            return list(rows)
    return [_row(line, length) for line in lines]


def _parse(text: bytes) -> Array | None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # what NumPy says of text that is no number
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def _parse_hundredths(text: bytes) -> Array | None:
    """Numbers that are all written with two decimals and one blank between: five times as fast as :func:`_parse`.

    None for any other text. The result is the same to the last bit: whole numbers divided by 100.
    """
    symbols = np.frombuffer(text + b" ", dtype=np.uint8)
    dots = np.flatnonzero(symbols == ord("."))
    if len(dots) == 0 or dots[-1] + 3 >= len(symbols) or (symbols == ord(" ")).sum() != len(dots):
        return None
    digits = all(((symbols[dots + k] - ord("0")) < 10).all() for k in (1, 2))
    if not digits or not (symbols[dots + 3] == ord(" ")).all():
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            whole = np.fromstring(text.replace(b".", b""), dtype=np.int64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    return whole / 100.0 if len(whole) == len(dots) else None


def _row(line: bytes, length: Callable[[Array], int]) -> Array | None:
    values = []
    for word in line.split():
        try:
            values.append(float(word))
        except ValueError:
            break  # the host's name, or damage
    row = np.array(values)
    size = length(row)
    return row[:size] if 0 < size <= len(row) else None


class _FrontLaser:
    """``n r1..rn x y theta odom_x odom_y odom_theta ipc_timestamp``."""

    tail = 7

    def rows(self, lines: list[bytes]) -> list[Array | None]:
        """Every line's numbers, None for broken lines."""
        return self._rows_of_hundredths(lines) or _rows(lines, self.row_length)

    def _rows_of_hundredths(self, lines: list[bytes]) -> list[Array | None] | None:
        """The quick way, for whole lines whose ranges are in centimetres, as CARMEN writes them; else None."""
        parts = [line.rsplit(None, self.tail + 2) for line in lines]  # host and logger stamp come behind
        tails = _parse(b" ".join(word for part in parts for word in part[1 : 1 + self.tail]))
        heads = [part[0].partition(b" ") for part in parts if part]
        ranges = _parse_hundredths(b" ".join(head[2] for head in heads))
        if tails is None or ranges is None or len(tails) != self.tail * len(lines):
            return None
        if not all(head[0].isdigit() and head[2].count(b" ") + 1 == int(head[0]) for head in heads):
            return None
        counts = np.array([int(head[0]) for head in heads])
        ends = np.cumsum(counts)
        table = tails.reshape(-1, self.tail)
        return [
            np.concatenate([[n], ranges[end - n : end], table[k]])
            for k, (n, end) in enumerate(zip(counts, ends, strict=True))
        ]

    def row_length(self, row: Array) -> int:
        return _count(row, 0) + 1 + self.tail if _count(row, 0) > 0 else -1

    def to_scans(self, rows: list[Array]) -> Scans:
        beams = np.array([int(row[0]) for row in rows], dtype=np.intp)
        tail = np.array([row[-self.tail :] for row in rows]).reshape(-1, self.tail)
        known = {n: _front_laser_grid(n) for n in set(beams.tolist())}
        grid = np.array([known[n] for n in beams.tolist()]).reshape(-1, 2)
        return Scans(
            stamps=tail[:, -1],
            ranges=[row[1 : -self.tail] for row in rows],
            beams=beams,
            start=grid[:, 0],
            resolution=grid[:, 1],
            max_range=np.full(len(rows), np.nan),
            laser=tail[:, :3],
            robot=tail[:, -4:-1],
            on_robot=False,
        )


class _LaserReading(_FrontLaser):
    """GMapping's ``n r1..rn odom_x odom_y odom_theta timestamp``: the scans that it kept."""

    tail = 4


class _RobotLaser:
    """``type start_angle fov resolution max_range accuracy remission_mode n r1..rn m e1..em``, then 12 numbers.

    ``laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward_safety side_safety turn_axis
    ipc_timestamp``.
    """

    head, tail = 8, 12

    def rows(self, lines: list[bytes]) -> list[Array | None]:
        """Every line's numbers, None for broken lines."""
        return _rows(lines, self.row_length)

    def row_length(self, row: Array) -> int:
        n = _count(row, self.head - 1)
        m = _count(row, self.head + n) if n > 0 else -1
        return self.head + n + 1 + m + self.tail if m >= 0 else -1

    def to_scans(self, rows: list[Array]) -> Scans:
        head = np.array([row[: self.head] for row in rows]).reshape(-1, self.head)
        tail = np.array([row[-self.tail :] for row in rows]).reshape(-1, self.tail)
        beams = head[:, 7].astype(np.intp)
        return Scans(
            stamps=tail[:, -1],
            ranges=[row[self.head : self.head + n] for row, n in zip(rows, beams, strict=True)],
            beams=beams,
            start=head[:, 1],
            resolution=head[:, 3],
            max_range=head[:, 4],
            laser=tail[:, :3],
            robot=tail[:, 3:6],
            on_robot=True,
        )


_LAYOUTS: dict[bytes, _FrontLaser | _RobotLaser] = {
    b"FLASER": _FrontLaser(),
    b"ROBOTLASER1": _RobotLaser(),
    b"LASER_READING": _LaserReading(),
}


def _count(row: Array, at: int) -> int:
    """A whole number of readings at a place in a row, or -1."""
    if at >= len(row) or not 0 <= row[at] <= 100_000 or row[at] != int(row[at]):
        return -1
    return int(row[at])


def _front_laser_grid(beams: int) -> tuple[float, float]:
    """First angle and resolution in rad of a front laser, by the number of its beams."""
    degrees = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}.get(beams, 180.0 / max(beams - 1, 1))
    return -math.pi / 2, math.radians(degrees)
