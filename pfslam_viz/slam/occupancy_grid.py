"""The log-odds occupancy grid, which grows as the robot goes: equations (20) to (29)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz.config import MapConfig

Array = NDArray[np.float64]

MARGIN = 64  # cells grown beyond what is asked for, so that growing stays rare
MARKS = np.iinfo(np.int32).max


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
        self._marks = np.zeros(self.log_odds.shape, np.int32)  # who came to a cell last: a cell counts once
        self._mark = 0

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

    def correlation(self, poses: Array, points: Array) -> NDArray[np.int64]:
        """(26) for poses (N, 3): how many occupied cells the end points (m, 2), in the robot's frame, mark."""
        from pfslam_viz.slam import kernels

        first = self._take_marks(len(poses))
        return kernels.correlate(poses, points, self.occupied, *self.origin, self.cell, self._marks, first)

    def project(self, pose: Array, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """End points (m, 2) in the world from ``pose`` (3,), and whether each falls on an occupied cell."""
        from pfslam_viz.slam import kernels

        return kernels.project(pose, points, self.occupied, *self.origin, self.cell)

    def add(self, pose: Array, points: Array, sensor: Array) -> None:
        """Write a scan seen from ``pose`` (3,), (28): ``points`` (m, 2) and ``sensor`` (2,) in the robot's frame."""
        from pfslam_viz.slam import kernels

        world, _ = self.project(pose, np.vstack([sensor[None], points]))
        cells = self.cells(world)
        cells += self.reach(cells.min(axis=0), cells.max(axis=0))
        c = self.config
        kernels.write_scan(
            self.log_odds,
            self.occupied,
            self._marks,
            self._take_marks(1),
            cells[0],
            cells[1:],
            c.log_odds_hit,
            c.log_odds_miss,
            c.log_odds_bound,
            c.threshold,
        )

    def reach(self, lowest: NDArray[np.int64], highest: NDArray[np.int64]) -> NDArray[np.int64]:
        """Grow until the cells ``lowest`` and ``highest`` (row, column) are inside; by how much indices moved (2,).

        The outermost ring of cells stays unknown, so that whoever looks beyond the grid finds an unknown cell.
        """
        before = (MARGIN - lowest) * (lowest < 1)
        after = (highest + 1 + MARGIN - self.shape) * (highest > np.array(self.shape) - 2)
        if before.any() or after.any():
            pad = tuple(zip(before.tolist(), after.tolist(), strict=True))
            self.log_odds = np.pad(self.log_odds, pad)
            self.occupied = np.pad(self.occupied, pad)
            self._marks = np.pad(self._marks, pad)
            self.origin = (self.origin[0] + int(before[0]), self.origin[1] + int(before[1]))
        return before

    def _take_marks(self, count: int) -> int:
        """The first of ``count`` marks that no cell carries."""
        if self._mark > MARKS - count - 1:
            self._marks[:] = 0
            self._mark = 0
        first = self._mark + 1
        self._mark += count
        return first
