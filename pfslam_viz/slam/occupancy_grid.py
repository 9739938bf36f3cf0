"""The log-odds occupancy grid, which grows as the robot goes: equations (20) to (29)."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]
Seen = tuple[Array, Array, Array]  # a scan: the pose (3,) it is seen from, end points (m, 2), lidar (2,)

MARGIN = 64  # cells grown beyond what is asked for, so that growing stays rare
WORTH_SHARING = 100  # poses; fewer are counted sooner than another thread wakes
MARKS = np.iinfo(np.uint8).max
EXACT = 2.0**-16  # float32 adds multiples of it without rounding, so that hits and misses cancel to 0, not to 1e-9


class OccupancyGrid:
    """A grid of log-odds in the world frame.

    Row 0 is the top (largest y) and column 0 the left (smallest x), as in (24) and (25): the point (x, y) lies in row
    ``floor(-y / cell) + origin[0]`` and column ``floor(x / cell) + origin[1]``.

    Attributes:
        config: cell size, increments, bound and threshold.
        log_odds: (rows, columns) float32; 0 is unknown.
        occupied: (rows, columns) uint8; 1 where log_odds > threshold, (29).
        origin: row and column of the cell at the world's origin, (24) and (25).
    """

    def __init__(self, config: MapConfig) -> None:
        self.config = config
        self.origin = (MARGIN, MARGIN)
        self.log_odds = np.zeros((2 * MARGIN, 2 * MARGIN), np.float32)
        self.occupied = np.zeros(self.log_odds.shape, np.uint8)
        self._scratch = Scratch(self.shape)
        self._marks: list[NDArray[np.uint8]] = []  # scratch grids, one for each of two threads that correlate
        numbers = (config.log_odds_hit, config.log_odds_miss, config.log_odds_bound, config.threshold)
        self._numbers = [np.float32(round(number / EXACT) * EXACT) for number in numbers]

    @property
    def cell(self) -> float:
        """Edge of a cell in m."""
        return self.config.cell

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.log_odds.shape
        return rows, columns

    @property
    def lower_left(self) -> tuple[float, float]:
        """World position (m) of the lower left corner: what ROS calls the map's origin."""
        return -self.origin[1] * self.cell, (self.origin[0] - self.shape[0]) * self.cell

    def cells(self, points: ArrayLike) -> NDArray[np.int64]:
        """Row and column (m, 2) of world points (m, 2), (24) and (25); they may lie outside the grid."""
        xy = np.asarray(points, dtype=np.float64)
        out = np.empty(xy.shape, np.int64)
        out[:, 0] = np.floor(-xy[:, 1] / self.cell)
        out[:, 1] = np.floor(xy[:, 0] / self.cell)
        return out + self.origin

    def centers(self, cells: ArrayLike) -> Array:
        """World positions (m, 2) of the centres of cells (m, 2) given as row, column."""
        rc = np.asarray(cells, dtype=np.float64)
        return np.stack(
            [(rc[:, 1] - self.origin[1] + 0.5) * self.cell, (self.origin[0] - rc[:, 0] - 0.5) * self.cell], axis=-1
        )

    def correlation(self, poses: Array, points: Array, worker: Worker | None = None) -> NDArray[np.int64]:
        """(26) for poses (N, 3): how many occupied cells the end points (m, 2), in the robot's frame, mark.

        A ``worker`` does its part of them; the counts are the same.
        """
        from pfslam_viz.slam import kernels

        counts, progress = np.empty(len(poses), np.int64), np.zeros(2, np.int64)
        if not self._marks or self._marks[0].shape != self.shape:
            self._marks = [np.empty(self.shape, np.uint8) for _ in range(2)]

        count = partial(kernels.correlate, poses, points, self.occupied, *self.origin, self.cell)
        mine, others = self._marks
        if worker is not None and len(poses) >= WORTH_SHARING:
            worker.submit(partial(count, others, counts, progress))
        count(mine, counts, progress)
        return counts

    def project(self, pose: Array, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """End points (m, 2) in the world from ``pose`` (3,), and whether each falls on an occupied cell."""
        from pfslam_viz.slam import kernels

        return kernels.project(pose, points, self.occupied, *self.origin, self.cell)

    def add(self, pose: Array, points: Array, lidar_position: Array) -> Array:
        """Write a scan seen from ``pose`` (3,), (28).

        ``points`` (m, 2) and ``lidar_position`` (2,) are in the robot's frame. Returns the points in the world, (m, 2).
        """
        from pfslam_viz.slam import map_kernels

        while True:
            inside, extent, world = map_kernels.add_scan(pose, points, lidar_position, *self._written(1))
            if inside:
                return world
            self._grow_to(*extent.tolist())

    def add_all(self, scans: Sequence[Seen]) -> None:
        """:meth:`add` up to 200 scans, one after the other."""
        from pfslam_viz.slam import map_kernels

        poses, points, lidar_positions = zip(*scans, strict=True)
        first = np.cumsum([0, *(len(p) for p in points)])
        arrays = np.array(poses), np.concatenate(points), first, np.array(lidar_positions)
        done = 0
        while True:
            done, extent = map_kernels.add_scans(*arrays, done, *self._written(len(scans)))
            if done == len(scans):
                return
            self._grow_to(*extent.tolist())

    def catch_up(self) -> None:
        """Begin to write what is not written yet, if the grid puts that off: somebody will look."""

    def _written(self, scans: int) -> tuple[Any, ...]:
        """What the kernels that write so many scans take of the grid, with marks that are new for each."""
        marks, first = self._scratch.marks, self._scratch.take(scans)
        return self.log_odds, self.occupied, marks, first, *self.origin, self.cell, *self._numbers

    def _grow_to(self, top: int, left: int, bottom: int, right: int) -> None:
        """Grow until these rows and columns, counted from the origin's cell, are inside.

        The outermost ring of cells stays unknown, so that whoever looks beyond the grid finds an unknown cell.
        """
        (row, column), (rows, columns) = self.origin, self.shape
        above = MARGIN - row - top if row + top < 1 else 0
        before = MARGIN - column - left if column + left < 1 else 0
        below = row + bottom + 1 + MARGIN - rows if row + bottom > rows - 2 else 0
        after = column + right + 1 + MARGIN - columns if column + right > columns - 2 else 0
        if above or before or below or after:
            pad = ((above, below), (before, after))
            self.log_odds, self.occupied = np.pad(self.log_odds, pad), np.pad(self.occupied, pad)
            self.origin = (row + above, column + before)
            self._scratch = Scratch(self.shape)


class Scratch:
    """A grid that remembers who came to a cell last, so that a cell counts once. Each taker gets marks of its own."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.marks = np.zeros(shape, np.uint8)
        self._last = 0

    def take(self, count: int) -> int:
        """The first of ``count`` successive marks that no cell carries."""
        if self._last > MARKS - count - 1:
            self.marks[:] = 0
            self._last = 0
        first = self._last + 1
        self._last += count
        return first
