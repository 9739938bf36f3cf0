"""The filter's hot loops: small pure functions, compiled by numba, arrays in and arrays out.

Each has a plain NumPy twin in ``tests/slam/test_kernels.py`` that it must match. A grid's row 0 is its top: the world
point (x, y) in m lies in row ``floor(-y / cell) + origin_row`` and column ``floor(x / cell) + origin_column``: (24)
and (25).
"""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.atomic import fetch_add

Floats = NDArray[np.float64]

APART = 40  # how far apart in the scan beams are that are looked up one after the other
TAKEN = 16  # poses that a thread takes at a time


@kernel("f8[:, ::1], f8[::1], f8[:, ::1]")
def move(poses: Floats, increment: Floats, noise: Floats) -> Floats:
    """Equations (13), (17), (18): every pose (N, 3) moved by the increment (3,) of its own frame, plus noise (N, 3)."""
    out = np.empty(poses.shape)
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        out[k, 0] = poses[k, 0] + c * increment[0] - s * increment[1] + noise[k, 0]
        out[k, 1] = poses[k, 1] + s * increment[0] + c * increment[1] + noise[k, 1]
        angle = poses[k, 2] + increment[2] + noise[k, 2]
        out[k, 2] = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return out


@kernel("f8[::1], f8[::1]")
def compose(pose: Floats, increment: Floats) -> Floats:
    """One pose (3,) moved by one increment (3,): :func:`pfslam_viz.geometry.compose` without its overhead."""
    out = np.empty(3)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    out[0] = pose[0] + c * increment[0] - s * increment[1]
    out[1] = pose[1] + s * increment[0] + c * increment[1]
    angle = pose[2] + increment[2]
    out[2] = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return out


@kernel("f8[::1], f8[:, ::1]")
def transform(pose: Floats, points: Floats) -> Floats:
    """Points (m, 2) of the frame of ``pose`` (3,) in the world's: :func:`pfslam_viz.geometry.transform`, sooner."""
    out = np.empty(points.shape)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for b in range(len(points)):
        out[b, 0] = pose[0] + c * points[b, 0] - s * points[b, 1]
        out[b, 1] = pose[1] + s * points[b, 0] + c * points[b, 1]
    return out


@kernel("f8[:, ::1], f8[::1]")
def moments(poses: Floats, weights: Floats) -> tuple[Floats, Floats, float]:
    """Mean pose (3,), (33), covariance (3, 3) and effective sample size, (30), of poses (N, 3); weights sum to 1."""
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


@kernel("f8[::1], f8[::1]")
def pick(weights: Floats, positions: Floats) -> NDArray[np.int64]:
    """The particles (k,) into whose share of [0, 1) the ascending ``positions`` (k,) fall, (31).

    ``weights`` (N,) need not sum to 1, and one at least is above 0; a particle without weight is never picked.
    """
    total, last = 0.0, 0
    for i in range(len(weights)):
        total += weights[i]
        if weights[i] > 0.0:
            last = i
    picked = np.empty(len(positions), np.int64)
    reached, i = weights[0], 0
    for k in range(len(positions)):
        while positions[k] * total >= reached and i < last:  # rounding must not carry a position beyond the last
            i += 1
            reached += weights[i]
        picked[k] = i
    return picked


@kernel("f8[:, ::1], f8[:, ::1], u1[:, ::1], i8, i8, f8, u1[:, ::1], i8[::1], i8[::1]", fastmath=True)
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
        most_up, least_up = poses[0, 1], poses[0, 1]
        for k in range(1, n):
            most_up, least_up = max(most_up, poses[k, 1]), min(least_up, poses[k, 1])
        highest, lowest = origin_row - most_up * scale - reach, origin_row - least_up * scale + reach
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


@kernel("f8[::1], f8[:, ::1], u1[:, ::1], i8, i8, f8")
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


@kernel("f4[::1], f8[:, ::1], f8[::1], f8, f8")
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
    kept = np.empty((m, 2))
    for k in range(m):
        kept[k, 0], kept[k, 1] = out[k, 0], out[k, 1]
    return kept
