"""What is shown of some scans only: grids, textures, walls, lines, camera images; and how many a recording may hold.

Plain arrays, copied, as in :mod:`pfslam_viz.viewer.scan_batch`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.images import UnusableImage, read_image
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.tiles import Box, Tiled
from pfslam_viz.viewer import kernels
from pfslam_viz.viewer.entities import MAP

if TYPE_CHECKING:
    from pathlib import Path

UNKNOWN = 255  # as in ROS: 0 is free, 100 occupied
IMAGE_SCALE = 2  # camera images are reduced by this
FARTHEST_DISPARITY = 1100  # raw; the formula has no depth beyond
GAPS = ((0.6, 20), (0.25, 6))  # m: gaps between rays that are drawn as free, but for a tint, as Rerun counts
WALL_HEIGHT = 0.6  # m: low enough to look over
AT_ONCE = 0.1  # of its bytes, what a budget may spend from the start
_LEVELS = 120  # of shade()'s 128 to either side: for one observation of the kind that counts more


@dataclass(frozen=True, slots=True)
class Cells:
    """A grid on the floor: (rows, columns) as ROS counts them, or RGBA colours (rows, columns, 4); row 0 is the top.

    ``corner`` (3,) m is the lower left one, ``cell`` m a cell's edge.
    """

    values: NDArray[np.uint8]
    cell: float
    corner: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Boxes:
    """Boxes (n, 3) along the axes: where their centres are, and half of how long, m."""

    centers: NDArray[np.float32]
    half_sizes: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Lines:
    """Polylines (m, 2) each, or (k, m, 2) for all of them, at height ``z`` m; ``levels`` of error, if they have any."""

    strips: Sequence[NDArray[np.float32]] | NDArray[np.float32]
    z: float
    levels: Sequence[int] = ()


@dataclass(frozen=True, slots=True)
class Spots:
    """Points (n, 2) on the floor, m, at height ``z``, and what is written beside each, if anything is."""

    points: NDArray[np.float32]
    z: float
    labels: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Jpeg:
    """An image, encoded."""

    contents: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Note:
    """A line of text with a level, as Rerun calls it."""

    text: str
    level: str


Content = Cells | Boxes | Lines | Spots | Jpeg | Note


@dataclass(frozen=True, slots=True)
class TimedContent:
    """What the entity ``path`` shows from scan ``step`` on, ``seconds`` after the first one.

    ``part`` is the block of it that does, empty where it is the entity itself (:mod:`pfslam_viz.viewer.blocks`).
    """

    path: str
    step: int
    seconds: float
    content: Content
    part: str = ""


@dataclass
class FrameBudget:
    """Spreads ``frames`` frames (maps, textures), and at most ``bytes`` of them uncompressed, over ``steps`` steps."""

    steps: int
    frames: int
    bytes: int
    every: int | None = None
    logged: int = 0
    skipped: int = 0
    _next: int = 0
    _spent: int = 0

    def is_due(self, step: int) -> bool:
        """Whether ``step`` (counted from 0) gets a frame."""
        return step >= self._next

    def allowance(self, step: int) -> int | None:
        """How many bytes the frame at ``step`` may take, so that later ones have theirs; None: as many as it needs.

        What is not taken stays for later frames, and a part is there from the start.
        """
        if self.every is not None:
            return None
        share = AT_ONCE + (1.0 - AT_ONCE) * min((step + 1) / self.steps, 1.0)
        return max(int(share * self.bytes) - self._spent, 0)

    def spend(self, step: int, size: int) -> None:
        """A frame of ``size`` bytes was logged at ``step``."""
        self.logged += 1
        self._spent += size
        if self.every is not None:
            self._next = step + self.every
            return
        rest, left = max(self.steps - step, 1), max(self.frames - self.logged, 1)
        self._next = step + max(rest // left, 1)


@cache
def _shades(hit: float, miss: float) -> tuple[NDArray[np.uint8], float]:
    """A table for :func:`kernels.shade`, and its steps, for a map that counts these log-odds an observation."""
    steps = _LEVELS / max(hit, miss)
    levels = np.arange(256) - 128
    log_odds = (levels + 0.5 * np.sign(levels)) / steps  # a level's far end: one observation lies in its last level
    certainty = np.where(log_odds > 0, log_odds / hit, log_odds / miss)
    return np.round(50.0 + 50.0 * np.clip(certainty, -1.0, 1.0)).astype(np.uint8), steps


def occupancy(log_odds: NDArray[np.float32], hit: float, miss: float) -> tuple[NDArray[np.uint8], slice, slice]:
    """The known part of a map, as ROS and Rerun count: 0 free to 100 occupied, 255 unknown; and its rows and columns.

    Where nothing is known, it is one cell. A cell's shade is its log-odds in observations, of which ``hit`` and
    ``miss`` are one each: one that found it free makes it white, one that found it occupied makes it black, and what
    lies between is grey. So maps of many scans and of few show the same floor alike, whatever they count with.
    """
    table, steps = _shades(hit, miss)
    cells, box = kernels.shade(log_odds, table, steps, UNKNOWN)
    return cells, *_slices(box)


def grid_map(grid: OccupancyGrid) -> Cells:
    """The known part of a grid. Row 0 is the top in both.

    Gaps between free cells are pale, narrow ones nearly white: a room that a few scans saw looks like one that many
    did, whose rays lie closer. A drawing: the grid, and the exported map, keep them unknown.
    """
    drawn, rows, columns = _drawn(grid.log_odds, grid)
    left, bottom = grid.lower_left
    corner = (left + columns.start * grid.cell, bottom + (grid.shape[0] - rows.stop) * grid.cell, MAP.z)
    return Cells(drawn, grid.cell, corner)


def _drawn(log_odds: NDArray[np.float32], grid: OccupancyGrid) -> tuple[NDArray[np.uint8], slice, slice]:
    """The known part of log-odds of the grid's kind, gaps bridged, and its rows and columns."""
    cells, rows, columns = occupancy(log_odds, grid.config.log_odds_hit, grid.config.log_odds_miss)
    drawn = cells
    for gap, tint in GAPS:
        drawn = kernels.bridge(cells, drawn, round(gap / grid.cell), 50, UNKNOWN, tint)
    return drawn, rows, columns


def gap_halo(cell: float) -> int:
    """How many cells round a block decide on what the gaps in it look like."""
    return max(round(gap / cell) for gap, _ in GAPS) + 1


def map_block(grid: OccupancyGrid, tiled: Tiled, box: Box) -> NDArray[np.uint8]:
    """A box of the grid's cells as in :func:`grid_map`, unknown ones too."""
    halo = gap_halo(grid.cell)
    top, left, bottom, right = box
    log_odds = tiled.dense((top - halo, left - halo, bottom + halo, right + halo))
    drawn, rows, columns = _drawn(log_odds, grid)
    out = np.full(log_odds.shape, UNKNOWN, np.uint8)
    out[rows, columns] = drawn
    return out[halo:-halo, halo:-halo]


def _slices(box: NDArray[np.int64]) -> tuple[slice, slice]:
    top, bottom, left, right = box.tolist()
    return slice(top, bottom + 1), slice(left, right + 1)


def texture_block(colors: Tiled, weight: Tiled, box: Box) -> NDArray[np.uint8]:
    """A box of a floor texture's cells as RGBA, transparent where nothing was painted."""
    painted = weight.dense(box) > 0
    out = np.empty((*painted.shape, 4), np.uint8)
    out[..., :3] = colors.dense(box)
    out[..., 3] = painted * np.uint8(255)
    return out


def wall_block(grid: OccupancyGrid, tiled: Tiled, box: Box) -> Boxes:
    """The occupied cells of a box as boxes, one for each run of them in a row, centred (z too) on half their height."""
    top, left = box[:2]
    occupied = np.pad(tiled.dense(box) > grid.threshold, ((0, 0), (1, 1)))
    width = occupied.shape[1] - 1
    changes = np.flatnonzero(
        occupied[:, 1:] != occupied[:, :-1]
    )  # in row order: where a run begins, where it ends, ...
    (rows, first), last = divmod(changes[::2], width), changes[1::2] % width
    half = np.full((len(rows), 3), grid.cell / 2, np.float32)
    half[:, 0] *= last - first
    half[:, 2] = WALL_HEIGHT / 2
    centers = np.full((len(rows), 3), WALL_HEIGHT / 2, np.float32)
    centers[:, 0] = (left + first) * grid.cell + half[:, 0]
    centers[:, 1] = -(top + rows + 0.5) * grid.cell
    return Boxes(centers, half)


def color_jpeg(path: "Path", scale: int = IMAGE_SCALE) -> Jpeg | None:
    """A colour frame, reduced, as JPEG; None where the file cannot be read."""
    import cv2

    image = _pixels(path)
    if image is None or image.ndim != 3 or image.dtype != np.uint8:
        return None
    height, width = image.shape[:2]
    return _jpeg(cv2.resize(image, (width // scale, height // scale), interpolation=cv2.INTER_AREA))


def disparity_jpeg(path: "Path", scale: int = IMAGE_SCALE) -> Jpeg | None:
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


def _jpeg(image: Any) -> Jpeg:
    import cv2

    return Jpeg(np.asarray(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1], np.uint8).ravel())


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
