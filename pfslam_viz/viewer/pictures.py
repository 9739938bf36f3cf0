"""Grids, textures and camera images as what Rerun shows, and how many of them a recording may hold."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.viewer.entities import MAP_Z

if TYPE_CHECKING:
    from pathlib import Path

UNKNOWN = 255  # as in ROS: 0 is free, 100 occupied
_STEPS = 12.0  # levels of the table below per unit of log-odds
_TABLE = np.round(100.0 / (1.0 + np.exp(-(np.arange(256) - 128) / _STEPS))).astype(np.uint8)


@dataclass
class FrameBudget:
    """Spreads ``frames`` pictures, and at most ``bytes`` of them uncompressed, over ``steps`` steps.

    A picture that grows in mid-run is shown less often, so that the viewer's memory holds the whole recording.
    """

    steps: int
    frames: int
    bytes: int
    every: int | None = None
    logged: int = 0
    skipped: int = 0
    _next: int = 0
    _spent: int = 0

    def is_due(self, step: int) -> bool:
        """Whether ``step`` (counted from 0) gets a picture."""
        return step >= self._next

    def spend(self, step: int, size: int) -> None:
        """A picture of ``size`` bytes was logged at ``step``."""
        self.logged += 1
        self._spent += size
        if self.every is not None:
            self._next = step + self.every
            return
        rest = max(self.steps - step, 1)
        left = min(max(self.frames - self.logged, 1), max((self.bytes - self._spent) // max(size, 1), 1))
        self._next = step + max(-(-rest // left), 1)


def known_box(grid: OccupancyGrid) -> tuple[slice, slice]:
    """Rows and columns that hold everything known; one cell where nothing is."""
    known = grid.log_odds != 0
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return slice(*(grid.origin[0], grid.origin[0] + 1)), slice(grid.origin[1], grid.origin[1] + 1)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def occupancy(log_odds: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Cells as ROS and Rerun count them: 0 free to 100 occupied, 255 unknown."""
    index = np.clip(log_odds * _STEPS + 128.5, 0, 255).astype(np.uint8)
    values = _TABLE[index]
    values[log_odds == 0] = UNKNOWN
    return values


def grid_map(grid: OccupancyGrid) -> tuple[Any, int]:
    """The known part of the grid as a GridMap, and its size in bytes. Row 0 is the top in both."""
    rows, columns = known_box(grid)
    cells = occupancy(grid.log_odds[rows, columns])
    height, width = cells.shape
    x, y = grid.lower_left
    corner = (x + columns.start * grid.cell, y + (grid.shape[0] - rows.stop) * grid.cell, MAP_Z)
    archetype = rr.GridMap(
        data=cells.tobytes(),
        format=rr.components.ImageFormat(width=width, height=height, color_model="L", channel_datatype="U8"),
        cell_size=grid.cell,
        translation=corner,
        colormap=rr.components.Colormap.RvizMap,
    )
    return archetype, cells.size


def jpeg(image: NDArray[np.uint8], quality: int = 85) -> bytes:
    """An RGB or grey image (rows, columns[, 3]) as JPEG."""
    import cv2

    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def encoded(contents: bytes) -> Any:
    """A JPEG to log."""
    return rr.EncodedImage(contents=contents, media_type="image/jpeg")


def color_jpeg(path: "Path", scale: int = 2) -> bytes | None:
    """A colour frame, reduced, as JPEG; None where the file cannot be read."""
    import cv2

    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        return None
    height, width = image.shape[:2]
    small = cv2.resize(image, (width // scale, height // scale), interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1])


def disparity_jpeg(path: "Path", scale: int = 2) -> bytes | None:
    """A disparity frame (uint16), near bright, pixels without depth black, reduced, as JPEG; None if unreadable."""
    import cv2

    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if raw is None or raw.ndim != 2:
        return None
    small = raw[::scale, ::scale].astype(np.float32)
    depth = -0.00304 * small + 3.31  # inverse depth up to a factor: what the eye reads as nearness
    valid = (small > 0) & (depth > 0.1) & (depth < 3.3)
    shade = np.where(valid, np.clip(depth / 2.6, 0.0, 1.0) * 215 + 40, 0).astype(np.uint8)
    colored = cv2.applyColorMap(shade, cv2.COLORMAP_INFERNO)
    colored[~valid] = 0
    return bytes(cv2.imencode(".jpg", colored, [cv2.IMWRITE_JPEG_QUALITY, 80])[1])
