"""LaserScan messages gathered, and brought to one grid of beam angles (sensor_msgs/LaserScan, REP 117).

A scan has as many beams as it has ranges, at angle_min + k * angle_increment; angle_max is not used: it is often a
whole turn, or off by one. The increment of a lidar that turns clockwise is negative.
"""

import math
from array import array
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.ros_transforms import frame_name, seconds

Array = NDArray[np.float64]
Shape = tuple[float, float, int]  # first angle and increment (rad), number of beams

_TURN = 2 * math.pi + 0.1
# Where the message gives no range_min, a reading nearer than this (m) is none: 0 is what drivers write for no return.
_RANGE_MIN = 0.05


@dataclass(frozen=True, slots=True)
class Grid:
    """Scans on one grid of angles.

    Attributes:
        angles: (B,) rad, increasing, counter-clockwise about the lidar's own z axis.
        ranges: (n, B) float32 m; 0 where there is none.
        clockwise: whether the messages' beams run the other way.
    """

    angles: Array
    ranges: NDArray[np.float32]
    clockwise: bool


class Scans:
    """The messages of one topic, in the order they came. Ranges are kept as float32 without gaps."""

    def __init__(self) -> None:
        self.stamps, self.received = array("d"), array("d")
        self.frames: list[str] = []
        self.shapes: list[Shape] = []
        self.limits = array("d")  # range_min, range_max a scan
        self.times = array("d")  # time_increment, scan_time a scan
        self._ranges = array("f")
        self._starts = [0]

    def __len__(self) -> int:
        return len(self.stamps)

    def add(self, message: object, received: float) -> None:
        """One LaserScan, received at a time in s."""
        self.stamps.append(seconds(message.header.stamp))  # type: ignore[attr-defined]
        self.received.append(received)
        self.frames.append(frame_name(message.header.frame_id))  # type: ignore[attr-defined]
        ranges = np.asarray(message.ranges, dtype=np.float32)  # type: ignore[attr-defined]
        first, step = _as_meant(float(message.angle_min)), _as_meant(float(message.angle_increment))  # type: ignore[attr-defined]
        self.shapes.append((first, step, len(ranges)))
        self.limits.extend((message.range_min, message.range_max))  # type: ignore[attr-defined]
        self.times.extend((message.time_increment, message.scan_time))  # type: ignore[attr-defined]
        self._ranges.frombytes(ranges.tobytes())
        self._starts.append(len(self._ranges))

    def usable(self, frame: str) -> NDArray[np.bool_]:
        """Which scans (n,) are of this frame and have beams that go round at most once."""
        return np.array(
            [f == frame and _is_possible(shape) for f, shape in zip(self.frames, self.shapes, strict=True)], dtype=bool
        )

    def gather(self, rows: NDArray[np.intp], notes: list[str]) -> Grid:
        """The scans ``rows`` (n,) on one grid of angles, that of most of them; the nearest beam where others differ.

        The gathered ranges are given away: this can be called once.
        """
        shapes = [self.shapes[k] for k in rows]
        counts = Counter(shapes)
        # Of equally frequent shapes the one with the most beams.
        common = max(counts, key=lambda shape: (counts[shape], shape[2]))
        flat = np.frombuffer(self._ranges, dtype=np.float32)
        if len(counts) == 1:
            every = flat.reshape(-1, common[2]) if len(set(self.shapes)) == 1 else None
            in_order = every is not None and np.array_equal(rows, np.arange(len(self)))
            ranges = every if every is not None and in_order else self._rows(flat, rows, common[2])
            angles = common[0] + common[1] * np.arange(common[2])
            if common[1] < 0:
                angles, ranges = angles[::-1].copy(), np.ascontiguousarray(ranges[:, ::-1])
            return Grid(angles, _cleaned(ranges), common[1] < 0)
        angles = _common_angles(counts, common)
        ranges = np.zeros((len(rows), len(angles)), dtype=np.float32)
        nearest = lru_cache(maxsize=64)(lambda shape: _nearest_beams(shape, angles))
        for row, (k, shape) in enumerate(zip(rows, shapes, strict=True)):
            at, beams = nearest(shape)
            ranges[row, at] = flat[self._starts[k] : self._starts[k + 1]][beams]
        beam_counts = sorted({shape[2] for shape in counts})
        if len(beam_counts) > 1:
            what = f"scans have {beam_counts[0]} to {beam_counts[-1]} beams"
        else:
            what = f"scans have {len(counts)} sets of beam angles"
        notes.append(f"lidar: {what}; brought to one grid of {len(angles)} angles, the nearest beam for each")
        return Grid(angles, _cleaned(ranges), common[1] < 0)

    def _rows(self, flat: NDArray[np.float32], rows: NDArray[np.intp], beams: int) -> NDArray[np.float32]:
        out = np.empty((len(rows), beams), dtype=np.float32)
        for row, k in enumerate(rows):
            out[row] = flat[self._starts[k] : self._starts[k + 1]]
        return out

    def range_limits(self, ranges: NDArray[np.float32], notes: list[str]) -> tuple[float, float]:
        """The lidar's limits in m as the messages say them; a reading of exactly the upper one is put to 0."""
        low, high = (_as_written(self._median(self.limits, k)) for k in (0, 1))
        if not low > 0:
            low = _RANGE_MIN
        if not high > low:
            high = float(ranges.max(initial=0.0))
            notes.append(f"lidar: range_max is not given; the longest range, {high:.2f} m, taken for it")
            return low, max(high, low + 1.0)
        if (share := float((ranges >= low).sum())) and float((ranges > np.float32(high)).sum()) > 0.5 * share:
            notes.append(f"lidar: more than half of the ranges are above range_max, {high:g} m, and thus no return")
        ranges[ranges == np.float32(high)] = 0.0
        return low, high

    def beam_time_increment(self, spacing: float, beams: int) -> tuple[float | None, str]:
        """Seconds between neighbouring beams and which field tells it, or None.

        ``time_increment``, else ``scan_time`` as the time of one turn. Values by which a sweep would take longer than
        one and a half times the ``spacing`` (s) of the scans are not believed.
        """
        increment, turn = self._median(self.times, 0), self._median(self.times, 1)
        step = abs(Counter(self.shapes).most_common(1)[0][0][1])
        for value, name in ((increment, "time_increment"), (turn * step / (2 * math.pi), "scan_time")):
            value = _as_written(value)
            if 0 < value * (beams - 1) < 1.5 * spacing:
                return value, name
        return None, ""

    def _median(self, pairs: "array[float]", column: int) -> float:
        values = np.array(pairs).reshape(-1, 2)[:, column]
        values = values[np.isfinite(values)]
        return float(np.median(values)) if len(values) else 0.0


def _is_possible(shape: Shape) -> bool:
    first, step, beams = shape
    return abs(first) < _TURN and abs(step) > 1e-5 and beams > 0 and abs(step) * (beams - 1) < _TURN


@lru_cache(maxsize=1024)
def _as_meant(angle: float) -> float:
    """An angle in rad before it was rounded to float32, where that is plain: some thousandths, 1024ths or thirds of 1°.

    Rounded angles are off by up to 1e-7 rad: little, but a filter's resampling falls otherwise by it in time.
    """
    rounded = np.float32(angle)
    for parts in (1000, 1024, 3):
        meant = math.radians(round(math.degrees(angle) * parts) / parts) if math.isfinite(angle) else angle
        if np.float32(meant) == rounded:
            return meant
    return angle


def _as_written(value: float) -> float:
    """The shortest decimal that gives the same float32: 5.6 for 5.599999904632568."""
    return float(str(np.float32(value)))


def _cleaned(ranges: NDArray[np.float32]) -> NDArray[np.float32]:
    """In place: +inf (no return), -inf (too near) and NaN (error) become 0, which is no return."""
    for row in ranges:  # row by row: a mask of all of them would be a quarter of their memory
        row[~np.isfinite(row)] = 0.0
    return ranges


def _common_angles(counts: "Counter[Shape]", common: Shape) -> Array:
    """The grid of the most frequent shape, continued as far as any scan reaches, at most once round."""
    step = abs(common[1])
    spans = [sorted((first, first + by * (beams - 1))) for first, by, beams in counts]
    start, end = sorted((common[0], common[0] + common[1] * (common[2] - 1)))
    before = math.floor((start - min(low for low, _ in spans)) / step + 0.01)
    after = math.floor((max(high for _, high in spans) - end) / step + 0.01)
    room = max(round(2 * math.pi / step) - common[2], 0)
    before = min(max(before, 0), room)
    after = min(max(after, 0), room - before)
    return start + step * np.arange(-before, common[2] + after, dtype=np.float64)


def _nearest_beams(shape: Shape, angles: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which angles of a grid have a beam within half a beam's width, and that beam; directions count, not turns."""
    first, step, beams = shape
    best = np.full(len(angles), -1)
    for turn in (0.0, 2 * math.pi, -2 * math.pi):
        at = np.rint((angles + turn - first) / step).astype(int)
        best = np.where((best < 0) & (at >= 0) & (at < beams), at, best)
    return np.flatnonzero(best >= 0), best[best >= 0]
