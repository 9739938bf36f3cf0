"""The log-odds occupancy grid, which grows as the robot goes: equations (20) to (29)."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz.errors import PfslamError
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.tiles import MARGIN, SLACK, WIDEST, Box, Index, Tiled, TiledArrays, distinct
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]
Seen = tuple[Array, Array, Array]  # a scan: the pose (3,) it is seen from, end points (m, 2), lidar (2,)

__all__ = ["MARGIN", "OccupancyGrid", "Scratch", "Seen"]

WORTH_SHARING = 100  # poses; fewer are counted sooner than another thread wakes
MARKS = np.iinfo(np.uint8).max
EXACT = 2.0**-16  # float32 adds multiples of it without rounding, so that hits and misses cancel to 0, not to 1e-9
MOST_CROSSED = 50_000_000  # cells that a scan may cross beyond the neighbourhood: more is no map, and fills the memory
USUAL, STRAY = 99, 2.0  # what is twice as far away as 99 per cent of a scan's end points is not waited for


class OccupancyGrid:
    """A grid of log-odds in the world frame.

    Row 0 is the top (largest y) and column 0 the left (smallest x), as in (24) and (25): the point (x, y) lies in row
    ``floor(-y / cell) + origin[0]`` and column ``floor(x / cell) + origin[1]``.

    A grid that has outgrown :data:`~pfslam_viz.slam.tiles.MOST` cells is kept in tiles where something was seen, and
    ``log_odds`` and ``occupied`` are put together anew whenever they are asked for: look at :meth:`tiled` instead, or
    at :meth:`occupied_cells`, where a map may be large.

    Attributes:
        config: cell size, increments, bound and threshold.
    """

    def __init__(self, config: MapConfig) -> None:
        self.config = config
        self._cells = TiledArrays({"log_odds": (np.float32, ())})
        self._occupied = np.zeros(self._cells.shape, np.uint8)
        self._scratch = Scratch(self._cells.shape)
        self._marks: list[NDArray[np.uint8]] = []  # scratch grids, one for each of two threads that correlate
        numbers = (config.log_odds_hit, config.log_odds_miss, config.log_odds_bound, config.threshold)
        self._numbers = [np.float32(round(number / EXACT) * EXACT) for number in numbers]

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """(rows, columns); 0 is unknown."""
        return self.tiled().dense(self.tiled().box()) if self._cells.windowed else self._cells.arrays["log_odds"]

    @property
    def occupied(self) -> NDArray[np.uint8]:
        """(rows, columns); 1 where log_odds > threshold, (29)."""
        return (self.log_odds > self._numbers[3]).view(np.uint8) if self._cells.windowed else self._occupied

    @property
    def origin(self) -> tuple[int, int]:
        """Row and column of the cell at the world's origin, (24) and (25)."""
        if not self._cells.windowed:
            return self._cells.origin
        top, left, _, _ = self.tiled().box()
        return -top, -left

    @property
    def cell(self) -> float:
        """Edge of a cell in m."""
        return self.config.cell

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        if not self._cells.windowed:
            return self._cells.shape
        top, left, bottom, right = self.tiled().box()
        return bottom - top + 1, right - left + 1

    @property
    def threshold(self) -> np.float32:
        """Log-odds above which a cell is occupied, (29)."""
        return self._numbers[3]

    def box(self) -> Box:
        """First row and column, last row and column of the grid, counted from the world origin's cell."""
        if self._cells.windowed:
            return self.tiled().box()
        (row, column), (rows, columns) = self._cells.origin, self._cells.shape
        return -row, -column, rows - row - 1, columns - column - 1

    def tiled(self) -> Tiled:
        """The log-odds where something is known, in tiles."""
        return self._cells.tiled("log_odds")[0]

    def occupied_cells(self) -> Index:
        """Row and column (m, 2) of the occupied cells, counted from the world origin's, in row order."""
        return self.tiled().where(lambda log_odds: log_odds > self._numbers[3])

    @property
    def has_walls(self) -> bool:
        """Whether any cell is occupied."""
        return self.tiled().any(lambda log_odds: log_odds > self._numbers[3])

    def wall_positions(self) -> Array:
        """World positions (m, 2) of the centres of the occupied cells, in row order."""
        return _centers(self.occupied_cells(), self.cell)

    def window(self) -> tuple[NDArray[np.uint8], tuple[int, int]]:
        """``occupied`` in the neighbourhood of the last scan, or all of a small grid, and where its origin lies."""
        return self._occupied, self._cells.origin

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
        return _centers(np.asarray(cells, dtype=np.float64) - self.origin, self.cell)

    def correlation(self, poses: Array, points: Array, worker: Worker | None = None) -> NDArray[np.int64]:
        """(26) for poses (N, 3): how many occupied cells the end points (m, 2), in the robot's frame, mark.

        A ``worker`` does its part of them; the counts are the same.
        """
        from pfslam_viz.slam import kernels

        if self._cells.windowed:
            self._look_round(poses, points)
        counts, progress = np.empty(len(poses), np.int64), np.zeros(2, np.int64)
        occupied, origin = self.window()
        if not self._marks or self._marks[0].shape != occupied.shape:
            self._marks = [np.empty(occupied.shape, np.uint8) for _ in range(2)]

        count = partial(kernels.correlate, poses, points, occupied, *origin, self.cell)
        mine, others = self._marks
        if worker is not None and len(poses) >= WORTH_SHARING:
            worker.submit(partial(count, others, counts, progress))
        count(mine, counts, progress)
        return counts

    def project(self, pose: Array, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """End points (m, 2) in the world from ``pose`` (3,), and whether each falls on an occupied cell."""
        from pfslam_viz.slam import kernels

        world, hits = kernels.project(pose, points, self._occupied, *self._cells.origin, self.cell)
        if self._cells.windowed:
            cells = self._from_origin(world)
            far = self._cells.outside(cells)
            if far.any():
                hits[far] = self._cells.far("log_odds", cells[far]) > self._numbers[3]
        return world, hits

    def add(self, pose: Array, points: Array, lidar_position: Array) -> Array:
        """Write a scan seen from ``pose`` (3,), (28).

        ``points`` (m, 2) and ``lidar_position`` (2,) are in the robot's frame. Returns the points in the world, (m, 2).
        Raises PfslamError for a scan that reaches further than any map could.
        """
        from pfslam_viz.slam import map_kernels

        while True:
            inside, extent, world = map_kernels.add_scan(pose, points, lidar_position, *self._written(1))
            if inside:
                return world
            if not self._cover(extent, points):
                self._add_far(pose, points, lidar_position)
                return world

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
            if not self._cover(extent, points[done]):
                self._add_far(*scans[done])
                done += 1

    def catch_up(self) -> None:
        """Begin to write what is not written yet, if the grid puts that off: somebody will look."""

    def _written(self, scans: int) -> tuple[Any, ...]:
        """What the kernels that write so many scans take of the grid, with marks that are new for each."""
        marks, first = self._scratch.marks, self._scratch.take(scans)
        log_odds = self._cells.arrays["log_odds"]
        return log_odds, self._occupied, marks, first, *self._cells.origin, self.cell, *self._numbers

    def _cover(self, extent: Index, points: Array) -> bool:
        """Have a scan's extent (4,) inside: rows and columns from the world origin's cell.

        False for a scan that is wider than a window may be, or than most of its ``points`` (m, 2) ask for.
        """
        top, left, bottom, right = extent.tolist()
        if not self._cells.holds_all(top, left, bottom, right) and len(points):
            farthest = float(np.hypot(points[:, 0], points[:, 1]).max())
            if farthest > self._reach(points):
                return False
        self._reshape(self._cells.cover(top, left, bottom, right))
        return True

    def _reach(self, points: Array) -> float:
        """How far (m) a window looks for a scan's end points (m, 2) in the robot's frame: most of them lie within."""
        if not len(points):
            return 0.0
        usual = STRAY * float(np.percentile(np.hypot(points[:, 0], points[:, 1]), USUAL))
        return min(usual, (WIDEST // 2 - SLACK) * self.cell)

    def _reshape(self, changed: bool) -> None:
        """The log-odds have been put elsewhere, if they have ``changed``: what goes with them follows.

        The outermost ring of cells counts as unoccupied, so that whoever looks beyond the grid finds no wall.
        """
        if changed:
            self._occupied = (self._cells.arrays["log_odds"] > self._numbers[3]).view(np.uint8)
            for ring in (self._occupied[[0, -1]], self._occupied[:, [0, -1]]):
                if ring.any():
                    self._occupied[[0, -1]] = 0
                    self._occupied[:, [0, -1]] = 0
            self._scratch = Scratch(self._cells.shape)

    def _look_round(self, poses: Array, points: Array) -> None:
        """Have the map round poses (N, 3) in the arrays, as far as their scans reach."""
        reach = self._reach(points)
        low, high = poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)
        corners = self._from_origin(np.array([low - reach, high + reach]))
        (bottom, left), (top, right) = corners.tolist()
        self._reshape(self._cells.cover(top, left, bottom, right))

    def _from_origin(self, points: Array) -> Index:
        """Row and column (m, 2) of world points (m, 2), counted from the world origin's cell."""
        return np.floor(np.stack([-points[:, 1], points[:, 0]], axis=-1) / self.cell).astype(np.int64)

    def _add_far(self, pose: Array, points: Array, lidar_position: Array) -> None:
        """:meth:`add` a scan that reaches beyond any window: cell by cell, wherever these are."""
        from pfslam_viz.slam import map_kernels

        cells, _, _ = map_kernels.end_cells(pose, points, lidar_position, self.cell)
        steps, slopes = map_kernels.bundles(cells)
        wide = 1.0 + np.abs(slopes[:, 1] - slopes[:, 0]) * steps[:, :2].mean(axis=1)
        if ((steps[:, 1] - steps[:, 0]) * wide).sum() > MOST_CROSSED:
            reach = float(np.hypot(points[:, 0], points[:, 1]).max())
            raise PfslamError(
                f"a scan reaches {reach:,.0f} m and crosses more cells of {self.cell:g} m than a map can hold:"
                " leave long beams out with observation.max_range, or take larger cells (map.cell)"
            )
        apart = np.abs(cells[1:] - cells[0]).max(axis=1)
        near = np.vstack([cells[:1], cells[1:][apart * self.cell <= self._reach(points)]])
        self._reshape(self._cells.cover(*near.min(axis=0).tolist(), *near.max(axis=0).tolist()))
        hit, miss, bound, threshold = self._numbers
        ends = distinct(cells[1:])
        crossed = distinct(map_kernels.scan_cells(cells), without=ends)
        self._change(ends, lambda values: np.minimum(values + hit, bound), threshold)
        self._change(crossed, lambda values: np.maximum(values - miss, -bound), threshold)

    def _change(self, cells: Index, change: Any, threshold: np.float32) -> None:
        """Put ``change`` of the log-odds into different cells (m, 2), inside and outside of the arrays."""
        far = self._cells.outside(cells)
        self._cells.put("log_odds", cells[far], change(self._cells.far("log_odds", cells[far])))
        i, j = (cells[~far] + self._cells.origin).T
        log_odds = self._cells.arrays["log_odds"]
        log_odds[i, j] = change(log_odds[i, j])
        within = (i > 0) & (j > 0) & (i < log_odds.shape[0] - 1) & (j < log_odds.shape[1] - 1)
        self._occupied[i, j] = (log_odds[i, j] > threshold) & within


def _centers(cells: ArrayLike, cell: float) -> Array:
    """World positions (m, 2) of the centres of cells (m, 2) of ``cell`` m, counted from the world origin's."""
    rc = np.asarray(cells, dtype=np.float64)
    return np.stack([(rc[:, 1] + 0.5) * cell, (-rc[:, 0] - 0.5) * cell], axis=-1)


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
