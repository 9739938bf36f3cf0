"""The layouts of CARMEN's scan messages: a line's numbers to scans. Nothing here knows what they are for."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.carmen_numbers import leading_numbers, parse, parse_hundredths, whole_number

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
        own_angles: whether the lines give ``start`` and ``resolution``; else they are guessed by the number of beams.
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
    own_angles: bool

    def take(self, kept: NDArray[np.intp]) -> "Scans":
        """The scans of the given indices, in their order."""
        return replace(
            self,
            stamps=self.stamps[kept],
            ranges=[self.ranges[k] for k in kept],
            beams=self.beams[kept],
            start=self.start[kept],
            resolution=self.resolution[kept],
            max_range=self.max_range[kept],
            laser=self.laser[kept],
            robot=self.robot[kept],
        )

    def at(self, stamps: Array) -> "Scans":
        """The same scans with other stamps."""
        return replace(self, stamps=stamps)


class FrontLaser:
    """``n r1..rn x y theta odom_x odom_y odom_theta ipc_timestamp``."""

    tail = 7

    def rows(self, lines: list[bytes]) -> list[Array | None]:
        """Every line's numbers, None for broken lines."""
        return self._rows_of_hundredths(lines) or leading_numbers(lines, self.row_length)

    def _rows_of_hundredths(self, lines: list[bytes]) -> list[Array | None] | None:
        """The quick way, for whole lines whose ranges are in centimetres, as CARMEN writes them; else None."""
        parts = [line.rsplit(None, self.tail + 2) for line in lines]  # host and logger stamp come behind
        tails = parse(b" ".join(word for part in parts for word in part[1 : 1 + self.tail]))
        heads = [part[0].partition(b" ") for part in parts if part]
        ranges = parse_hundredths(b" ".join(head[2] for head in heads))
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
        return whole_number(row, 0) + 1 + self.tail if whole_number(row, 0) > 0 else -1

    def to_scans(self, rows: list[Array]) -> Scans:
        beams = np.array([int(row[0]) for row in rows], dtype=np.intp)
        tail = np.array([row[-self.tail :] for row in rows]).reshape(-1, self.tail)
        known = {n: front_laser_grid(n) for n in set(beams.tolist())}
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
            own_angles=False,
        )


class LaserReading(FrontLaser):
    """GMapping's ``n r1..rn odom_x odom_y odom_theta timestamp``: the scans that it kept."""

    tail = 4


class RobotLaser:
    """``type start_angle fov resolution max_range accuracy remission_mode n r1..rn m e1..em``, then 12 numbers.

    ``laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward_safety side_safety turn_axis
    ipc_timestamp``.
    """

    head, tail = 8, 12

    def rows(self, lines: list[bytes]) -> list[Array | None]:
        """Every line's numbers, None for broken lines."""
        return leading_numbers(lines, self.row_length)

    def row_length(self, row: Array) -> int:
        n = whole_number(row, self.head - 1)
        m = whole_number(row, self.head + n) if n > 0 else -1
        return self.head + n + 1 + m + self.tail if m >= 0 else -1

    def to_scans(self, rows: list[Array]) -> Scans:
        head = np.array([row[: self.head] for row in rows]).reshape(-1, self.head)
        tail = np.array([row[-self.tail :] for row in rows]).reshape(-1, self.tail)
        poses = tail[:, :6] if self.tail > 1 else np.zeros((len(rows), 6))
        beams = head[:, 7].astype(np.intp)
        return Scans(
            stamps=tail[:, -1],
            ranges=[row[self.head : self.head + n] for row, n in zip(rows, beams, strict=True)],
            beams=beams,
            start=head[:, 1],
            resolution=head[:, 3],
            max_range=head[:, 4],
            laser=poses[:, :3],
            robot=poses[:, 3:],
            on_robot=self.tail > 1,
            own_angles=True,
        )


class RawLaser(RobotLaser):
    """As :class:`RobotLaser` up to the remissions, then only ``ipc_timestamp``: no poses (all are zero)."""

    tail = 1


def front_laser_grid(beams: int) -> tuple[float, float]:
    """First angle and resolution in rad of a front laser, by the number of its beams."""
    degrees = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}.get(beams, 180.0 / max(beams - 1, 1))
    return -math.pi / 2, math.radians(degrees)
