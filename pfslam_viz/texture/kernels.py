"""The loop over the pixels of a frame."""

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
    for v in range(rows):
        color_row = color_rows[v]
        if color_row < 0 or color_row >= color.shape[0]:
            continue
        for u in range(columns):
            d = np.int32(disparity[v, u])
            if d < low[v, u] or d > high[v, u]:
                continue
            color_column = int(np.floor(color_columns[u] - color_shifts[d] + np.float32(0.5)))
            if color_column < 0 or color_column >= color.shape[1]:
                continue
            depth = depths[d]
            ahead, side = depth * rays[v, u, 0], depth * rays[v, u, 1]
            robot_x, robot_y = position[0] + ahead, position[1] + side
            row = int(np.floor(-(y + sin * robot_x + cos * robot_y) / cell)) - top
            column = int(np.floor((x + cos * robot_x - sin * robot_y) / cell)) - left
            if row < 0 or column < 0 or row >= size or column >= size:
                continue
            patch[row, column, 0] += color[color_row, color_column, 0]
            patch[row, column, 1] += color[color_row, color_column, 1]
            patch[row, column, 2] += color[color_row, color_column, 2]
            patch[row, column, 3] += np.float32(1.0)
            first_row, last_row = min(first_row, row), max(last_row, row)
            first_column, last_column = min(first_column, column), max(last_column, column)
    return first_row, last_row, first_column, last_column
