"""The filter's hot loops: small pure functions, compiled by numba, arrays in and arrays out.

Each has a plain NumPy twin in ``tests/slam/test_kernels.py`` that it must match. A grid's row 0 is its top: the world
point (x, y) in m lies in row ``floor(-y / cell) + origin_row`` and column ``floor(x / cell) + origin_column``, (24, 25).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def correlate(
    poses: Floats,
    points: Floats,
    occupied: NDArray[np.uint8],
    origin_row: int,
    origin_column: int,
    cell: float,
    visited: NDArray[np.int32],
    mark: int,
) -> NDArray[np.int64]:
    """Equation (26): for every pose (N, 3), how many occupied cells of the map the scan's end points (m, 2) mark.

    ``points`` are in the robot's frame. A cell counts once, however many beams end in it. ``visited`` is a scratch grid
    in which the marks ``mark`` to ``mark + N - 1`` have not been used. Cells outside the grid do not count.
    """
    rows, columns = occupied.shape
    counts = np.zeros(len(poses), np.int64)
    scale = 1.0 / cell
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]) * scale, math.sin(poses[k, 2]) * scale
        x, y = poses[k, 0] * scale, poses[k, 1] * scale
        count = 0
        for b in range(len(points)):
            column = int(math.floor(x + c * points[b, 0] - s * points[b, 1])) + origin_column
            row = int(math.floor(-(y + s * points[b, 0] + c * points[b, 1]))) + origin_row
            if (
                0 <= row < rows
                and 0 <= column < columns
                and occupied[row, column]
                and visited[row, column] != mark + k
            ):
                visited[row, column] = mark + k
                count += 1
        counts[k] = count
    return counts


@njit(cache=True, nogil=True)
def project(
    pose: Floats, points: Floats, occupied: NDArray[np.uint8], origin_row: int, origin_column: int, cell: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """End points (m, 2) in the world from one pose, (23), and whether each falls on an occupied cell."""
    rows, columns = occupied.shape
    out = np.empty_like(points)
    hits = np.zeros(len(points), np.bool_)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for b in range(len(points)):
        x = pose[0] + c * points[b, 0] - s * points[b, 1]
        y = pose[1] + s * points[b, 0] + c * points[b, 1]
        out[b, 0], out[b, 1] = x, y
        row, column = int(math.floor(-y / cell)) + origin_row, int(math.floor(x / cell)) + origin_column
        hits[b] = 0 <= row < rows and 0 <= column < columns and occupied[row, column] != 0
    return out, hits


@njit(cache=True, nogil=True)
def _add(
    log_odds: NDArray[np.float32],
    occupied: NDArray[np.uint8],
    row: int,
    column: int,
    change: float,
    bound: float,
    threshold: float,
) -> None:
    value = min(max(log_odds[row, column] + change, -bound), bound)
    log_odds[row, column] = value
    occupied[row, column] = value > threshold


@njit(cache=True, nogil=True)
def write_scan(
    log_odds: NDArray[np.float32],
    occupied: NDArray[np.uint8],
    touched: NDArray[np.int32],
    mark: int,
    start: NDArray[np.int64],
    ends: NDArray[np.int64],
    hit: float,
    miss: float,
    bound: float,
    threshold: float,
) -> None:
    """Equations (28) and (29): write one scan into the grid, in place.

    ``start`` (2,) is the lidar's cell, ``ends`` (m, 2) those of the end points (row, column), all inside the grid. Cells
    with an end point gain ``hit``; the other cells of the Bresenham lines towards them, the lidar's included, lose
    ``miss``. A cell changes once a scan. Log-odds stay within +-``bound``. ``mark`` must be new to ``touched``.
    """
    for b in range(len(ends)):
        row, column = ends[b, 0], ends[b, 1]
        if touched[row, column] != mark:
            touched[row, column] = mark
            _add(log_odds, occupied, row, column, hit, bound, threshold)
    for b in range(len(ends)):
        if b > 0 and ends[b, 0] == ends[b - 1, 0] and ends[b, 1] == ends[b - 1, 1]:
            continue  # neighbouring beams often end in one cell: the same line again
        row, column = start[0], start[1]
        rows, columns = abs(ends[b, 0] - row), abs(ends[b, 1] - column)
        down = 1 if ends[b, 0] >= row else -1
        right = 1 if ends[b, 1] >= column else -1
        error = columns - rows
        for _ in range(max(rows, columns)):
            if touched[row, column] != mark:
                touched[row, column] = mark
                _add(log_odds, occupied, row, column, -miss, bound, threshold)
            twice = 2 * error
            if twice > -rows:
                error -= rows
                column += right
            if twice < columns:
                error += columns
                row += down


def warm_up() -> None:
    """Compile every kernel, or load it from the cache of an earlier run."""
    grid, scratch = np.zeros((4, 4), np.float32), np.zeros((4, 4), np.int32)
    occupied, points = np.zeros((4, 4), np.uint8), np.zeros((1, 2))
    correlate(np.zeros((1, 3)), points, occupied, 2, 2, 1.0, scratch, 1)
    project(np.zeros(3), points, occupied, 2, 2, 1.0)
    cell = np.full(2, 2, np.int64)
    write_scan(grid, occupied, scratch, 1, cell, cell[None], 1.0, 1.0, 10.0, 0.0)
