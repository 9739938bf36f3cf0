"""The loops over the pixels of a frame, and over the cells that they fell into."""

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
    by_row: Float32,
    by_column: Float32,
    position: Array,
    tolerance: float,
    max_range: float,
    depths: Float32,
    color_columns: Float32,
    color_rows: NDArray[np.int32],
    color_shift: Float32,
):
    """Sum up one frame's floor pixels by cell; both images from the view's first rows on.

    ``patch`` (n, n, 4) float32 is overwritten: per cell, the sums of red, green and blue, and the number of pixels. Its
    cell [0, 0] is ``top``, ``left``, counted from the world origin's cell. ``x``, ``y``, ``cos``, ``sin`` are the
    robot's pose, the arguments from ``by_row`` on a :class:`~pfslam_viz.texture.kinect.FloorView`'s. Answers the first
    and last row and column that were touched (last < first: none).
    """
    patch[:] = 0.0
    cells = patch.reshape(-1, 4)
    size, columns, width = np.int32(len(patch)), disparity.shape[1], np.int32(color.shape[1])
    box_top, box_bottom, box_left, box_right = size, np.int32(-1), size, np.int32(-1)
    # A pixel's cell is (down, right) + depth * (its ray, turned), in cells; positive within the patch.
    turn_x, turn_y = np.float32(cos / cell), np.float32(sin / cell)
    right = np.float32((x + cos * position[0] - sin * position[1]) / cell - left)
    down = np.float32(-(y + sin * position[0] + cos * position[1]) / cell - top)
    least, most = np.float32(position[2] - tolerance), np.float32(position[2] + tolerance)  # below the camera
    farthest, last, none, one = np.float32(max_range), np.uint16(len(depths) - 1), np.int32(-1), np.int32(1)
    rounding = np.float32(1.5)  # and then one less: conversion cuts towards zero
    depth = np.empty(columns, np.float32)
    row, column, index, color_column = np.empty((4, columns), np.int32)
    # Neighbours often fall into one cell: sums wait in registers until the next cell comes.
    here, red, green, blue, count = none, 0, 0, 0, 0
    for v in range(len(disparity)):
        if color_rows[v] < 0 or color_rows[v] >= len(color):
            continue
        raw, shown, ray = disparity[v], color[color_rows[v]], by_row[v]
        for u in range(columns):
            depth[u] = depths[min(raw[u], last)]
        for u in range(columns):  # vectorised by the compiler, which is why pixels that are no floor are not skipped
            ahead = depth[u] * (ray[0] + by_column[0, u])
            side = depth[u] * (ray[1] + by_column[1, u])
            below = -depth[u] * (ray[2] + by_column[2, u])
            row[u] = np.int32(down - (turn_y * ahead + turn_x * side))
            column[u] = np.int32(right + (turn_x * ahead - turn_y * side))
            shift = color_shift[0] + color_shift[1] * np.float32(raw[u])
            color_column[u] = np.int32(color_columns[u] - shift + rounding) - one
            floor = (depth[u] > 0.0) & (below >= least) & (below <= most) & (ahead <= farthest)
            inside = (row[u] >= 0) & (row[u] < size) & (column[u] >= 0) & (column[u] < size)
            colored = (color_column[u] >= 0) & (color_column[u] < width)
            index[u] = row[u] * size + column[u] if floor & inside & colored else none
        for u in range(columns):
            if index[u] < 0:
                continue
            if index[u] != here:
                if count > 0:
                    _put(cells[here], red, green, blue, count)
                here = index[u]
                red, green, blue, count = 0, 0, 0, 0
                box_top, box_bottom = min(box_top, row[u]), max(box_bottom, row[u])
                box_left, box_right = min(box_left, column[u]), max(box_right, column[u])
            pixel = shown[np.uint32(color_column[u])]
            red += pixel[0]
            green += pixel[1]
            blue += pixel[2]
            count += 1
    if count > 0:
        _put(cells[here], red, green, blue, count)
    return box_top, box_bottom, box_left, box_right


@njit(cache=True, nogil=True)
def _put(sums: Float32, red: int, green: int, blue: int, count: int) -> None:
    sums[0] += np.float32(red)
    sums[1] += np.float32(green)
    sums[2] += np.float32(blue)
    sums[3] += np.float32(count)


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
