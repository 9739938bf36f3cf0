"""Grids, textures and camera images as what Rerun shows, and how many of them a recording may hold."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pfslam_viz.recordings.images import UnusableImage, read_image
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.viewer import kernels
from pfslam_viz.viewer.entities import MAP_Z, TEXTURE_Z

if TYPE_CHECKING:
    from pathlib import Path

    from pfslam_viz.texture import FloorTexture

UNKNOWN = 255  # as in ROS: 0 is free, 100 occupied
FARTHEST_DISPARITY = 1100  # raw; the formula has no depth beyond
WALL_HEIGHT = 0.6  # m: low enough to look over
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


def _box(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns that hold everything in the mask; one cell where nothing is."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return slice(0, 1), slice(0, 1)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def occupancy(log_odds: NDArray[np.float32]) -> tuple[NDArray[np.uint8], slice, slice]:
    """Cells as ROS and Rerun count them: 0 free to 100 occupied, 255 unknown; and the rows and columns that are known.

    Where nothing is known, the rows and columns are those of one cell.
    """
    cells, (top, bottom, left, right) = kernels.shade(log_odds, _TABLE, _STEPS, UNKNOWN)
    if bottom < top:
        return cells, slice(0, 1), slice(0, 1)
    return cells, slice(int(top), int(bottom) + 1), slice(int(left), int(right) + 1)


def grid_map(grid: OccupancyGrid) -> tuple[Any, int]:
    """The known part of the grid as a GridMap, and its size in bytes. Row 0 is the top in both."""
    cells, rows, columns = occupancy(grid.log_odds)
    known = cells[rows, columns]
    return _grid_map(known, grid.cell, grid.lower_left, grid.shape, rows, columns, MAP_Z), known.size


def _grid_map(
    cells: NDArray[np.uint8],
    cell: float,
    lower_left: tuple[float, float],
    shape: tuple[int, int],
    rows: slice,
    columns: slice,
    z: float,
) -> Any:
    """``cells``, cut at ``rows`` and ``columns`` from a grid of ``shape``, as a GridMap in its place."""
    height, width = cells.shape[:2]
    gray = cells.ndim == 2
    corner = (lower_left[0] + columns.start * cell, lower_left[1] + (shape[0] - rows.stop) * cell, z)
    return rr.GridMap(
        data=np.ascontiguousarray(cells).reshape(-1),
        format=rr.components.ImageFormat(
            width=width, height=height, color_model="L" if gray else "RGBA", channel_datatype="U8"
        ),
        cell_size=cell,
        translation=corner,
        colormap=rr.components.Colormap.RvizMap if gray else None,
        opacity=None if gray else 0.999,
    )


def texture_map(texture: "FloorTexture") -> tuple[Any, int]:
    """The painted part of the floor texture as a GridMap, transparent elsewhere, and its size in bytes."""
    painted = texture.weight > 0
    rows, columns = _box(painted)
    colors = np.zeros((*painted[rows, columns].shape, 4), np.uint8)
    colors[..., :3] = texture.color[rows, columns]
    colors[..., 3] = painted[rows, columns] * np.uint8(255)
    return _grid_map(colors, texture.cell, texture.lower_left, texture.shape, rows, columns, TEXTURE_Z), colors.size


def walls(grid: OccupancyGrid) -> Any:
    """The occupied cells as boxes, one for each run of them in a row, centred (z too) on :data:`WALL_HEIGHT` / 2."""
    occupied = np.pad(grid.occupied > 0, ((0, 0), (1, 1)))
    width = occupied.shape[1] - 1
    changes = np.flatnonzero(
        occupied[:, 1:] != occupied[:, :-1]
    )  # in row order: where a run begins, where it ends, ...
    (rows, first), last = divmod(changes[::2], width), changes[1::2] % width
    left = grid.centers(np.stack([rows, first], axis=-1))
    half = np.full((len(rows), 3), grid.cell / 2, np.float32)
    half[:, 0] *= last - first
    half[:, 2] = WALL_HEIGHT / 2
    centers = np.full((len(rows), 3), WALL_HEIGHT / 2, np.float32)
    centers[:, 0] = left[:, 0] - grid.cell / 2 + half[:, 0]
    centers[:, 1] = left[:, 1]
    return rr.Boxes3D(centers=centers, half_sizes=half)


def encoded(contents: bytes) -> Any:
    """A JPEG to log."""
    array = np.frombuffer(contents, np.uint8)  # bytes are converted 40 times as slowly
    return rr.EncodedImage(contents=array, media_type="image/jpeg")


def color_jpeg(path: "Path", scale: int = 2) -> bytes | None:
    """A colour frame, reduced, as JPEG; None where the file cannot be read."""
    import cv2

    image = _pixels(path)
    if image is None or image.ndim != 3 or image.dtype != np.uint8:
        return None
    height, width = image.shape[:2]
    return _jpeg(cv2.resize(image, (width // scale, height // scale), interpolation=cv2.INTER_AREA))


def disparity_jpeg(path: "Path", scale: int = 2) -> bytes | None:
    """A disparity frame (uint16), near bright, pixels without depth black, reduced, as JPEG; None if unreadable."""
    import cv2

    raw = _pixels(path)
    if raw is None or raw.ndim != 2:
        return None
    shades, colors = _nearness()
    return _jpeg(cv2.applyColorMap(shades[np.minimum(raw[::scale, ::scale], FARTHEST_DISPARITY)], colors))


def _pixels(path: "Path") -> NDArray[Any] | None:
    try:
        return read_image(path)
    except UnusableImage:
        return None


def _jpeg(image: Any) -> bytes:
    import cv2

    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1])


@cache
def _nearness() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A shade for each raw disparity up to FARTHEST_DISPARITY, near bright, 0 without depth, (34); and the shades' BGR
    colours (256, 1, 3)."""
    import cv2

    raw = np.arange(FARTHEST_DISPARITY + 1)
    inverse_depth = -0.00304 * raw + 3.31  # up to a factor: what the eye reads as nearness
    valid = (raw > 0) & (inverse_depth > 0.1) & (inverse_depth < 3.3)
    shades: NDArray[np.uint8] = np.where(valid, np.clip(inverse_depth / 2.6, 0.0, 1.0) * 215 + 40, 0).astype(np.uint8)
    colors = np.array(cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_INFERNO), np.uint8)
    colors[0] = 0
    return shades, colors
