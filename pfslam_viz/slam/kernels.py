"""The filter's hot loops: small pure functions, compiled by numba, arrays in and arrays out.

Each has a plain NumPy twin in ``tests/slam/test_kernels.py`` that it must match. A grid's row 0 is its top: the world
point (x, y) in m lies in row ``floor(-y / cell) + origin_row`` and column ``floor(x / cell) + origin_column``: (24)
and (25).
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz.slam.atomic import fetch_add

Floats = NDArray[np.float64]

APART = 40  # how far apart in the scan beams are that are looked up one after the other
TAKEN = 16  # poses that a thread takes at a time


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
def compose(pose: Floats, increment: Floats) -> Floats:
    """One pose (3,) moved by one increment (3,): :func:`pfslam_viz.geometry.compose` without its overhead."""
    out = np.empty(3)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    out[0] = pose[0] + c * increment[0] - s * increment[1]
    out[1] = pose[1] + s * increment[0] + c * increment[1]
    angle = pose[2] + increment[2]
    out[2] = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return out


@njit(cache=True, nogil=True)
def transform(pose: Floats, points: Floats) -> Floats:
    """Points (m, 2) of the frame of ``pose`` (3,) in the world's: :func:`pfslam_viz.geometry.transform`, sooner."""
    out = np.empty_like(points)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for b in range(len(points)):
        out[b, 0] = pose[0] + c * points[b, 0] - s * points[b, 1]
        out[b, 1] = pose[1] + s * points[b, 0] + c * points[b, 1]
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


@njit(cache=True, nogil=True)
def pick(weights: Floats, positions: Floats) -> NDArray[np.int64]:
    """The particles (k,) into whose share of [0, 1) the ascending ``positions`` (k,) fall, (31).

    ``weights`` (N,) need not sum to 1, and one at least is above 0; a particle without weight is never drawn.
    """
    total, last = 0.0, 0
    for i in range(len(weights)):
        total += weights[i]
        if weights[i] > 0.0:
            last = i
    drawn = np.empty(len(positions), np.int64)
    reached, i = weights[0], 0
    for k in range(len(positions)):
        while positions[k] * total >= reached and i < last:  # rounding must not carry a position beyond the last
            i += 1
            reached += weights[i]
        drawn[k] = i
    return drawn


@njit(cache=True, nogil=True, fastmath=True)
def correlate(
    poses: Floats,
    points: Floats,
    occupied: NDArray[np.uint8],
    origin_row: int,
    origin_column: int,
    cell: float,
    marks: NDArray[np.uint8],
    counts: NDArray[np.int64],
    progress: NDArray[np.int64],
) -> None:
    """Equation (26): for every pose (N, 3), how many occupied cells of the map the scan's end points (m, 2) mark.

    ``points`` are in the robot's frame. A cell counts once, however many beams end in it. The grid's outermost ring
    of cells must be unoccupied: points outside the grid are looked up there. ``marks`` is a scratch grid of the
    map's shape, whatever it holds. The answer goes to ``counts`` (N,).

    ``progress`` (2,) is how many poses were taken and how many are done, [0, 0] at first. Threads that call with the
    same one, each with ``marks`` of its own, share the poses as they get free; each returns when all are done.

    Cells are found in float32, twice as fast: an end point within 1e-4 of a cell's edge may fall on its other side.
    """
    n = len(poses)
    taken = fetch_add(progress, 0, TAKEN)
    if taken < n:
        rows, columns = occupied.shape
        m = len(points)
        scale = 1.0 / cell
        px, py = np.empty(m, np.float32), np.empty(m, np.float32)
        reach, b = 0.0, 0
        # Beams far apart follow each other: a cell just written is not read in the next turn, which would have to wait.
        for first in range(APART):
            for other in range(first, m, APART):
                px[b], py[b] = points[other, 0] * scale, points[other, 1] * scale
                reach = max(reach, points[other, 0] ** 2 + points[other, 1] ** 2)
                b += 1
        # Of the scratch grid, only the rows that the scan reaches are needed.
        reach = math.sqrt(reach) * scale + 1.0
        highest, lowest = origin_row - poses[:, 1].max() * scale - reach, origin_row - poses[:, 1].min() * scale + reach
        top, bottom = int(min(max(highest, 0.0), rows - 1.0)), int(min(max(lowest, 0.0), rows - 1.0)) + 1
        marked = marks.ravel()
        reached, fresh = occupied.ravel()[top * columns : bottom * columns], marked[top * columns : bottom * columns]
        zero, most_right, most_down = np.float32(0.0), np.float32(columns - 0.5), np.float32(rows - 0.5)
        index = np.empty(m, np.uint32)
        used = 0
    while taken < n:
        end = min(taken + TAKEN, n)
        for k in range(taken, end):
            # A cell's mark is the last pose that came to it: 0 where none did, 255 in unoccupied cells.
            if used % 254 == 0:
                for i in range(len(fresh)):
                    fresh[i] = np.uint8(reached[i] - np.uint8(1))
            this = np.uint8(used % 254 + 1)
            used += 1
            c, s = np.float32(math.cos(poses[k, 2])), np.float32(math.sin(poses[k, 2]))
            x, y = np.float32(poses[k, 0] * scale + origin_column), np.float32(origin_row - poses[k, 1] * scale)
            for b in range(m):  # vectorised by the compiler; truncation is floor here, as nothing is negative
                column = min(max(x + c * px[b] - s * py[b], zero), most_right)
                row = min(max(y - s * px[b] - c * py[b], zero), most_down)
                index[b] = np.int32(row) * np.int32(columns) + np.int32(column)
            count = np.int64(0)
            for b in range(m):  # without branches
                mark = marked[index[b]]
                count += np.int64(mark < this)
                marked[index[b]] = max(mark, this)
            counts[k] = count
        fetch_add(progress, 1, end - taken)
        taken = fetch_add(progress, 0, TAKEN)
    while fetch_add(progress, 1, 0) < n:  # the other thread's last few
        pass


@njit(cache=True, nogil=True)
def project(
    pose: Floats, points: Floats, occupied: NDArray[np.uint8], origin_row: int, origin_column: int, cell: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """End points (m, 2) in the world from one pose, (23), and whether each falls on an occupied cell."""
    rows, columns = occupied.shape
    world, hits = transform(pose, points), np.zeros(len(points), np.bool_)
    for b in range(len(points)):
        row, column = math.floor(-world[b, 1] / cell) + origin_row, math.floor(world[b, 0] / cell) + origin_column
        hits[b] = 0 <= row < rows and 0 <= column < columns and occupied[row, column] != 0
    return world, hits


@njit(cache=True, nogil=True)
def end_cells(
    pose: Floats, points: Floats, sensor: Floats, cell: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Cells (m + 1, 2) of the lidar and of the end points seen from ``pose``, their extent, and the points (m, 2).

    ``points`` (m, 2) and ``sensor`` (2,) are in the robot's frame; the points come back in the world's. Cells are row,
    column from the cell at the world's origin, so that they hold however the grid grows; the extent (4,) is least row,
    column, greatest row, column.
    """
    cells = np.empty((len(points) + 1, 2), np.int64)
    lidar, world = transform(pose, sensor.reshape(1, 2)), transform(pose, points)
    extent = np.array([2**62, 2**62, -(2**62), -(2**62)])
    for b in range(len(cells)):
        x, y = (lidar[0, 0], lidar[0, 1]) if b == 0 else (world[b - 1, 0], world[b - 1, 1])
        cells[b, 0], cells[b, 1] = math.floor(-y / cell), math.floor(x / cell)
        for axis in range(2):
            extent[axis] = min(extent[axis], cells[b, axis])
            extent[axis + 2] = max(extent[axis + 2], cells[b, axis])
    return cells, extent, world


@njit(cache=True, nogil=True)
def write_scan(
    log_odds: NDArray[np.float32],
    occupied: NDArray[np.uint8],
    touched: NDArray[np.uint8],
    mark: int,
    cells: NDArray[np.int64],
    origin_row: int,
    origin_column: int,
    hit: np.float32,
    miss: np.float32,
    bound: np.float32,
    threshold: np.float32,
) -> None:
    """Equations (28) and (29): write one scan into the grid, in place.

    ``cells`` (m + 1, 2) are the lidar's and those of the end points, as :func:`end_cells` gives them, all inside the
    grid. Cells with an end point gain ``hit``; the other cells of the Bresenham lines towards them, the lidar's
    included, lose ``miss``. A cell changes once a scan. Log-odds stay within +-``bound``. ``mark`` must be new to
    ``touched``.
    """
    columns = log_odds.shape[1]
    values, above, seen = log_odds.ravel(), occupied.ravel(), touched.ravel()
    this = np.uint8(mark)
    for b in range(1, len(cells)):
        i = np.uint64((cells[b, 0] + origin_row) * columns + cells[b, 1] + origin_column)
        if seen[i] != this:
            seen[i] = this
            values[i] = min(values[i] + hit, bound)
            above[i] = values[i] > threshold
    start = (cells[0, 0] + origin_row) * columns + cells[0, 1] + origin_column
    fresh = np.empty(max(log_odds.shape), np.uint64)  # the line's cells that no earlier line crossed
    for b in range(1, len(cells)):
        if b > 1 and cells[b, 0] == cells[b - 1, 0] and cells[b, 1] == cells[b - 1, 1]:
            continue  # neighbouring beams often end in one cell: the same line again
        down, right = cells[b, 0] - cells[0, 0], cells[b, 1] - cells[0, 1]
        by_row, by_column = (columns if down > 0 else -columns), (1 if right > 0 else -1)
        if abs(down) > abs(right):
            long, short, along, across = abs(down), abs(right), by_row, by_column
        else:
            long, short, along, across = abs(right), abs(down), by_column, by_row
        # Bresenham's line in flat indices: a step across when the error passes half a cell.
        index, error, count = start, 0, np.uint64(0)
        for _ in range(long):
            i = np.uint64(index)
            fresh[count] = i
            count += np.uint64(seen[i] != this)
            seen[i] = this
            error += 2 * short
            index += along
            if error > long:  # compiled to a conditional move
                error -= 2 * long
                index += across
        for k in range(count):
            i = fresh[k]
            values[i] = max(values[i] - miss, -bound)
            above[i] = values[i] > threshold


@njit(cache=True, nogil=True)
def add_scan(
    pose: Floats,
    points: Floats,
    sensor: Floats,
    log_odds: NDArray[np.float32],
    occupied: NDArray[np.uint8],
    touched: NDArray[np.uint8],
    mark: int,
    origin_row: int,
    origin_column: int,
    cell: float,
    hit: np.float32,
    miss: np.float32,
    bound: np.float32,
    threshold: np.float32,
) -> tuple[bool, NDArray[np.int64], Floats]:
    """:func:`end_cells`, and :func:`write_scan` if they all lie within the grid's outermost ring.

    Returns whether they do, their extent (4,) from the cell at the world's origin and the points (m, 2) in the world.
    """
    cells, extent, world = end_cells(pose, points, sensor, cell)
    rows, columns = log_odds.shape
    inside = (
        extent[0] + origin_row >= 1
        and extent[1] + origin_column >= 1
        and extent[2] + origin_row <= rows - 2
        and extent[3] + origin_column <= columns - 2
    )
    if inside:
        write_scan(log_odds, occupied, touched, mark, cells, origin_row, origin_column, hit, miss, bound, threshold)
    return inside, extent, world


@njit(cache=True, nogil=True)
def add_scans(
    poses: Floats,
    points: Floats,
    first: NDArray[np.int64],
    sensors: Floats,
    done: int,
    log_odds: NDArray[np.float32],
    occupied: NDArray[np.uint8],
    touched: NDArray[np.uint8],
    mark: int,
    *rest: Any,
) -> tuple[int, NDArray[np.int64]]:
    """:func:`add_scan` from scan ``done`` on, until one does not fit; how many are done then, and that one's extent.

    Scan k is seen from ``poses[k]`` of (n, 3) with the lidar at ``sensors[k]`` of (n, 2); rows ``first[k]`` to
    ``first[k + 1]`` of ``points`` are its. ``mark`` to ``mark + n - 1`` must be new to ``touched``; the ``rest`` is as
    for :func:`add_scan`.
    """
    extent = np.zeros(4, np.int64)
    for k in range(done, len(poses)):
        inside, extent, _ = add_scan(
            poses[k],
            points[first[k] : first[k + 1]],
            sensors[k],
            log_odds,
            occupied,
            touched,
            mark + k,
            *rest,
        )
        if not inside:
            return k, extent
    return len(poses), extent


@njit(cache=True, nogil=True)
def read_scan(
    ranges: NDArray[np.float32], directions: Floats, origin: Floats, shortest: float, longest: float
) -> Floats:
    """Equation (22): end points (m, 2) of the ranges (B,) within the limits, along ``directions`` (B, 2)."""
    out = np.empty((len(ranges), 2))
    m = 0
    for b in range(len(ranges)):
        if shortest <= ranges[b] <= longest:
            out[m, 0] = origin[0] + ranges[b] * directions[b, 0]
            out[m, 1] = origin[1] + ranges[b] * directions[b, 1]
            m += 1
    return out[:m].copy()


def warm_up() -> None:
    """Compile every kernel, or load it from the cache of an earlier run."""
    grid, scratch = np.zeros((4, 4), np.float32), np.zeros((4, 4), np.uint8)
    occupied, points = np.zeros((4, 4), np.uint8), np.zeros((1, 2))
    pose = np.zeros((1, 3))
    move(pose, np.zeros(3), pose)
    compose(pose[0], pose[0])
    moments(pose, np.ones(1))
    pick(np.ones(1), np.zeros(1))
    correlate(pose, points, occupied, 2, 2, 1.0, occupied.copy(), np.zeros(1, np.int64), np.zeros(2, np.int64))
    project(np.zeros(3), points, occupied, 2, 2, 1.0)
    one = np.float32(1.0)
    add_scan(np.zeros(3), points, np.zeros(2), grid, occupied, scratch, 1, 2, 2, 1.0, one, one, one, one)
    first = np.array([0, 1])
    add_scans(pose, points, first, np.zeros((1, 2)), 0, grid, occupied, scratch, 2, 2, 2, 1.0, one, one, one, one)
    transform(pose[0], points)
    read_scan(np.ones(1, np.float32), points, np.zeros(2), 0.0, 2.0)
