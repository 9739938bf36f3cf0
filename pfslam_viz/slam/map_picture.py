"""A map as one array of cells, of a stated size at most: for images, which need the box round what is known.

One stray range of 20 km makes that box ten thousand million cells, nearly all of them unknown. A box that is too large
is cut to where the walls are, and if that is still too much, its cells are put together.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.tiles import Box, overlap

BULK = (0.5, 99.5)  # per cent of the occupied cells: single beams lie outside
ROUND, SEEN = 0.2, 15.0  # how much more is shown on every side: a share of the bulk's size, and m


@dataclass(frozen=True, slots=True)
class MapPicture:
    """``values`` (rows, columns, ...), row 0 at the top, of cells of ``cell`` m.

    ``upper_left`` and ``lower_left`` are where the corners lie in the world, m; ``note`` says what was left out, if
    anything was.
    """

    values: NDArray[Any]
    cell: float
    upper_left: tuple[float, float]
    note: str | None = None

    @property
    def lower_left(self) -> tuple[float, float]:
        """m"""
        left, top = self.upper_left
        return left, top - len(self.values) * self.cell


def map_picture(
    grid: OccupancyGrid,
    convert: Callable[[NDArray[np.float32]], NDArray[Any]],
    unknown: NDArray[Any],
    *,
    most: int,
    border: int = 0,
) -> MapPicture:
    """The known part of a map and a ``border`` of cells, at most ``most`` cells; all of a grid that knows nothing.

    ``convert`` makes of log-odds (n, n) what is shown of them (n, n, ...), ``unknown`` (...) is what it makes of 0. Of
    cells that are put together, an occupied one counts before a free one.
    """
    tiled = grid.tiled()
    known, whole = tiled.known_box(), grid.box()
    if known is not None:
        whole = _common(_wider(known, border), whole)
    box, step = _fitted(grid, tiled.size, whole, most)
    (top, left, _, _), (rows, columns) = box, _size(box, step)
    out = np.empty((rows, columns, *unknown.shape), unknown.dtype)
    out[:] = unknown
    for k in range(len(tiled)):
        at = (int(tiled.rows[k]) * tiled.size - top) // step, (int(tiled.columns[k]) * tiled.size - left) // step
        (down, within), (right, beside) = (
            overlap(first, tiled.size // step, size) for first, size in zip(at, (rows, columns), strict=True)
        )
        if down.stop > down.start and right.stop > right.start:
            values = _coarse(tiled.pool[tiled.index[k]], step, grid.threshold)
            out[down, right] = convert(values[within, beside])
    cell = grid.cell * step
    return MapPicture(
        out, cell, (left * grid.cell, -top * grid.cell), None if box == whole else _note(whole, box, cell)
    )


def _fitted(grid: OccupancyGrid, tile: int, whole: Box, most: int) -> tuple[Box, int]:
    """The box to show of the ``whole``, of whole steps, and how many cells along an edge are put together."""
    step = 1
    if _count(whole, step) <= most:
        return whole, step
    box = _common(_bulk(grid, whole), whole)
    while _count(box, step) > most and step < tile:
        step *= 2
    if _count(box, step) > most:  # walls everywhere, kilometres apart
        half = int(most**0.5) * step // 2 - step
        row, column = (box[0] + box[2]) // 2, (box[1] + box[3]) // 2
        box = _common((row - half, column - half, row + half, column + half), box)
    top, left = box[0] // step * step, box[1] // step * step
    rows, columns = _size((top, left, box[2], box[3]), step)
    return (top, left, top + rows * step - 1, left + columns * step - 1), step


def _bulk(grid: OccupancyGrid, whole: Box) -> Box:
    """Where the walls are, but for single ones, and some of what is round them."""
    cells = grid.occupied_cells()
    if not len(cells):
        return whole
    low = np.percentile(cells, BULK[0], axis=0, method="higher")  # of a few cells too, the outmost is not in it
    high = np.percentile(cells, BULK[1], axis=0, method="lower")
    (top, left), (bottom, right) = low, high
    around = ROUND * (high - low) + SEEN / grid.cell
    return int(top - around[0]), int(left - around[1]), int(bottom + around[0]), int(right + around[1])


def _coarse(log_odds: NDArray[np.float32], step: int, threshold: np.float32) -> NDArray[np.float32]:
    """Of ``step``² cells the most surely occupied one, or else the most surely free one."""
    if step == 1:
        return log_odds
    n = len(log_odds) // step
    blocks = log_odds.reshape(n, step, n, step)
    highest, lowest = blocks.max(axis=(1, 3)), blocks.min(axis=(1, 3))
    return np.asarray(np.where((highest > threshold) | (lowest == 0.0), highest, lowest), np.float32)


def _note(whole: Box, box: Box, cell: float) -> str:
    (rows, columns), (shown, across) = _size(whole, 1), _size(box, 1)
    part = (
        "all of it" if shown >= rows and across >= columns else f"{shown:,} x {across:,} of them, where the walls are"
    )
    return f"the map spans {rows:,} x {columns:,} cells; shown is {part}, in cells of {cell:g} m"


def _size(box: Box, step: int) -> tuple[int, int]:
    top, left, bottom, right = box
    return -(-(bottom + 1 - top) // step), -(-(right + 1 - left) // step)


def _count(box: Box, step: int) -> int:
    rows, columns = _size(box, step)
    return rows * columns


def _wider(box: Box, by: int) -> Box:
    return box[0] - by, box[1] - by, box[2] + by, box[3] + by


def _common(box: Box, other: Box) -> Box:
    """What two boxes have in common."""
    return max(box[0], other[0]), max(box[1], other[1]), min(box[2], other[2]), min(box[3], other[3])
