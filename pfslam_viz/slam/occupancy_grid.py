"""The log-odds occupancy grid, which grows as the robot goes: equations (20) to (29)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz.config import MapConfig

MARGIN_CELLS = 64  # grown beyond what is asked for, so that growing stays rare


@dataclass(slots=True)
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

    config: MapConfig
    log_odds: NDArray[np.float32] = field(init=False)
    occupied: NDArray[np.uint8] = field(init=False)
    touched: NDArray[np.int32] = field(init=False)  # the last scan that wrote a cell: a cell counts once a scan
    origin: tuple[int, int] = field(init=False)
    scans: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        n = 2 * MARGIN_CELLS
        self.log_odds = np.zeros((n, n), np.float32)
        self.occupied = np.zeros((n, n), np.uint8)
        self.touched = np.zeros((n, n), np.int32)
        self.origin = (MARGIN_CELLS, MARGIN_CELLS)

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
        row = np.floor(-xy[:, 1] / self.cell).astype(np.int64) + self.origin[0]
        column = np.floor(xy[:, 0] / self.cell).astype(np.int64) + self.origin[1]
        return np.stack([row, column], axis=-1)

    def centers(self, cells: ArrayLike) -> NDArray[np.float64]:
        """World positions (m, 2) of the centres of cells (m, 2) given as row, column."""
        rc = np.asarray(cells, dtype=np.float64)
        return np.stack(
            [(rc[:, 1] - self.origin[1] + 0.5) * self.cell, (self.origin[0] - rc[:, 0] - 0.5) * self.cell], axis=-1
        )
