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
def move(poses: Floats, increment: Floats, noise: Floats) -> Floats:
    """Equations (13), (17), (18): every pose (N, 3) moved by the increment (3,) of its own frame, plus noise (N, 3)."""
    out = np.empty_like(poses)
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        out[k, 0] = poses[k, 0] + c * increment[0] - s * increment[1] + noise[k, 0]
        out[k, 1] = poses[k, 1] + s * increment[0] + c * increment[1] + noise[k, 1]
        angle = poses[k, 2] + increment[2] + noise[k, 2]
        out[k, 2] = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return out


@njit(cache=True, nogil=True)
def moments(poses: Floats, weights: Floats) -> tuple[Floats, Floats, float]:
    """Mean pose (3,), (33), covariance (3, 3) about it and N_eff, (30), of poses (N, 3) whose weights sum to 1."""
    mean, covariance = np.zeros(3), np.zeros((3, 3))
    sine = cosine = squares = 0.0
    for k in range(len(poses)):
        w = weights[k]
        mean[0] += w * poses[k, 0]
        mean[1] += w * poses[k, 1]
        sine += w * math.sin(poses[k, 2])
        cosine += w * math.cos(poses[k, 2])
        squares += w * w
    mean[2] = math.atan2(sine, cosine)
    for k in range(len(poses)):
        dx, dy = poses[k, 0] - mean[0], poses[k, 1] - mean[1]
        turn = poses[k, 2] - mean[2]
        turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
        covariance[0, 0] += weights[k] * dx * dx
        covariance[0, 1] += weights[k] * dx * dy
        covariance[0, 2] += weights[k] * dx * turn
        covariance[1, 1] += weights[k] * dy * dy
        covariance[1, 2] += weights[k] * dy * turn
        covariance[2, 2] += weights[k] * turn * turn
    covariance[1, 0], covariance[2, 0], covariance[2, 1] = covariance[0, 1], covariance[0, 2], covariance[1, 2]
    return mean, covariance, 1.0 / squares


@njit(cache=True, nogil=True, fastmath=True)
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

    ``points`` are in the robot's frame. A cell counts once, however many beams end in it. The grid's outermost ring
    of cells must be unoccupied: points outside the grid are looked up there. ``visited`` is a scratch grid that does
    not yet contain the marks ``mark`` to ``mark + N - 1``.
    """
    rows, columns = occupied.shape
    m = len(points)
    counts = np.zeros(len(poses), np.int64)
    scale = 1.0 / cell
    px, py = points[:, 0] * scale, points[:, 1] * scale
    flat, seen = occupied.ravel(), visited.ravel()
    index = np.empty(m, np.uint32)
    short = np.empty(m + 1, np.uint32)
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        x, y = poses[k, 0] * scale + origin_column, origin_row - poses[k, 1] * scale
        for b in range(m):  # vectorised by the compiler; truncation is floor here, as nothing is negative
            column = min(max(x + c * px[b] - s * py[b], 0.0), columns - 0.5)
            row = min(max(y - s * px[b] - c * py[b], 0.0), rows - 0.5)
            index[b] = np.int32(row) * np.int32(columns) + np.int32(column)
        # Three passes without branches: neighbours in one cell, unoccupied cells and repeated cells drop out.
        last, distinct = np.uint32(0), np.uint64(0)
        for b in range(m):
            short[distinct] = index[b]
            distinct += np.uint64(index[b] != last)
            last = index[b]
        hits = np.uint64(0)
        for b in range(distinct):
            short[hits] = short[b]
            hits += np.uint64(flat[short[b]])
        count = 0
        this = np.int32(mark + k)
        for b in range(hits):
            count += np.int64(seen[short[b]] != this)
            seen[short[b]] = this
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
    pose = np.zeros((1, 3))
    move(pose, np.zeros(3), pose)
    moments(pose, np.ones(1))
    correlate(pose, points, occupied, 2, 2, 1.0, scratch, 1)
    project(np.zeros(3), points, occupied, 2, 2, 1.0)
    cell = np.full(2, 2, np.int64)
    write_scan(grid, occupied, scratch, 1, cell, cell[None], 1.0, 1.0, 10.0, 0.0)
