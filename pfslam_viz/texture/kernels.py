"""The loops over the pixels of a frame, and over the cells that they fell into."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]


@njit(cache=True, nogil=True)
def collect(  # type: ignore[no-untyped-def]
    patch: Float32,
    top: int,
    left: int,
    cell: float,
    disparity: NDArray[np.uint16],
    color: NDArray[np.uint8],
    x: float,
    y: float,
    cos: float,
    sin: float,
    rays: Float32,
    position: Array,
    low: NDArray[np.int32],
    high: NDArray[np.int32],
    depths: Float32,
    color_columns: Float32,
    color_rows: NDArray[np.int32],
    color_shifts: Float32,
):
    """Sum up one frame's floor pixels by cell.

    ``patch`` (n, n, 4) float32 is overwritten: per cell, the sums of red, green and blue, and the number of pixels. Its
    cell [0, 0] is ``top``, ``left``, counted from the world origin's cell. ``x``, ``y``, ``cos``, ``sin`` are the
    robot's pose, the arrays from ``rays`` on a :class:`~pfslam_viz.texture.kinect.FloorView`'s. Answers the first and
    last row and column that were touched (last < first: none).
    """
    patch[:] = 0.0
    rows, columns = disparity.shape
    size = patch.shape[0]
    first_row, last_row, first_column, last_column = size, -1, size, -1
    # Neighbours often fall into one cell: sums wait in registers until the next cell comes.
    here_row, here_column, red, green, blue, count = -1, -1, 0, 0, 0, 0
    # A pixel's cell is (down, right) + depth * (its ray, turned), in cells; positive within the patch.
    turn_x, turn_y = np.float32(cos / cell), np.float32(sin / cell)
    right = (x + cos * position[0] - sin * position[1]) / cell - left
    down = -(y + sin * position[0] + cos * position[1]) / cell - top
    for v in range(rows):
        color_row = color_rows[v]
        if color_row < 0 or color_row >= color.shape[0]:
            continue
        for u in range(columns):
            d = disparity[v, u]
            if d < low[v, u] or d > high[v, u]:
                continue
            # In double precision: numba's floor of a single is a call, which costs as much as the rest of the pixel.
            color_column = math.floor(color_columns[u] - color_shifts[d] + 0.5)
            if color_column < 0 or color_column >= color.shape[1]:
                continue
            depth = depths[d]
            ahead, side = depth * rays[v, u, 0], depth * rays[v, u, 1]
            row = math.floor(down - (turn_y * ahead + turn_x * side))
            column = math.floor(right + (turn_x * ahead - turn_y * side))
            if row < 0 or column < 0 or row >= size or column >= size:
                continue
            if row != here_row or column != here_column:
                if count > 0:
                    _put(patch, here_row, here_column, red, green, blue, count)
                here_row, here_column = row, column
                red, green, blue, count = 0, 0, 0, 0
                first_row, last_row = min(first_row, row), max(last_row, row)
                first_column, last_column = min(first_column, column), max(last_column, column)
            red += color[color_row, color_column, 0]
            green += color[color_row, color_column, 1]
            blue += color[color_row, color_column, 2]
            count += 1
    if count > 0:
        _put(patch, here_row, here_column, red, green, blue, count)
    return first_row, last_row, first_column, last_column


@njit(cache=True, nogil=True)
def _put(patch: Float32, row: int, column: int, red: int, green: int, blue: int, count: int) -> None:
    patch[row, column, 0] += np.float32(red)
    patch[row, column, 1] += np.float32(green)
    patch[row, column, 2] += np.float32(blue)
    patch[row, column, 3] += np.float32(count)


@njit(cache=True, nogil=True)
def merge(patch: Float32, total: Float32, weight: Float32, color: NDArray[np.uint8]) -> int:
    """Add the sums of a ``patch`` (r, c, 4), as of :func:`collect`, to those of the same cells of a texture.

    ``total`` (r, c, 3) are the texture's sums of red, green and blue, ``weight`` (r, c) its numbers of pixels,
    ``color`` (r, c, 3) the mean colours. Answers how many cells were touched.
    """
    touched = 0
    for i in range(patch.shape[0]):
        for j in range(patch.shape[1]):
            if patch[i, j, 3] == 0.0:
                continue
            touched += 1
            weight[i, j] += patch[i, j, 3]
            for channel in range(3):
                total[i, j, channel] += patch[i, j, channel]
                color[i, j, channel] = np.uint8(np.rint(total[i, j, channel] / weight[i, j]))
    return touched
