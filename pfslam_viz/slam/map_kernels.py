"""The loops that write scans into an occupancy grid: compiled by numba, arrays in and arrays out.

Each has a plain NumPy twin in ``tests/slam/test_map_kernels.py`` that it must match. Rows and columns are as in
:mod:`pfslam_viz.slam.kernels`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.kernels import Floats, transform

BELOW_HALF = 0.5 - 1e-9  # of a cell; a line's offset is a half, or at least 1 / (2 x its length) away from it


@kernel("f8[::1], f8[:, ::1], f8[::1], f8")
def end_cells(
    pose: Floats, points: Floats, lidar_position: Floats, cell: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Cells (m + 1, 2) of the lidar and of the end points seen from ``pose``, their extent, and the points (m, 2).

    ``points`` (m, 2) and ``lidar_position`` (2,) are in the robot's frame; the points come back in the world's. Cells
    are row, column from the cell at the world's origin, so that they hold however the grid grows; the extent (4,) is
    least row, column, greatest row, column.
    """
    cells = np.empty((len(points) + 1, 2), np.int64)
    world = transform(pose, points)
    cos, sin, forward, left = math.cos(pose[2]), math.sin(pose[2]), lidar_position[0], lidar_position[1]
    lidar_x, lidar_y = pose[0] + cos * forward - sin * left, pose[1] + sin * forward + cos * left
    extent = np.empty(4, np.int64)
    extent[0], extent[1], extent[2], extent[3] = 2**62, 2**62, -(2**62), -(2**62)
    for b in range(len(cells)):
        x, y = (lidar_x, lidar_y) if b == 0 else (world[b - 1, 0], world[b - 1, 1])
        cells[b, 0], cells[b, 1] = math.floor(-y / cell), math.floor(x / cell)
        for axis in range(2):
            extent[axis] = min(extent[axis], cells[b, axis])
            extent[axis + 2] = max(extent[axis + 2], cells[b, axis])
    return cells, extent, world


@kernel("i8[:, ::1]")
def bundles(cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
    """The lines from the first of the ``cells`` (m + 1, 2) to each of the others, as bundles of lines side by side.

    Bundle k goes on from step ``begin`` to before step ``end`` in the direction ``down``, ``right`` in which its lines
    are longest: row k of (n, 4). Row k of (n, 2) is its least and greatest slope, in cells beside that direction a
    step. Its lines, in their order, are at most a cell apart: they cross every cell between the outermost two.
    """
    steps, slopes = np.empty((2 * len(cells), 4), np.int64), np.empty((2 * len(cells), 2))
    # A stack of bundles that have not ended, each a part of the one below it; the lowest has no length.
    length, least, greatest = np.zeros(len(cells) + 1, np.int64), np.zeros(len(cells) + 1), np.zeros(len(cells) + 1)
    count = top = down = right = 0
    slope = 0.0
    for b in range(1, len(cells) + 1):
        reach, next_down, next_right, next_slope, together = 0, 0, 0, 0.0, 0  # after the last line, all bundles end
        if b < len(cells):
            if b > 1 and cells[b, 0] == cells[b - 1, 0] and cells[b, 1] == cells[b - 1, 1]:
                continue  # neighbouring beams often end in one cell: the same line again
            rows, columns = cells[b, 0] - cells[0, 0], cells[b, 1] - cells[0, 1]
            if rows == 0 and columns == 0:
                continue
            if abs(rows) > abs(columns):
                reach, next_down, next_slope = abs(rows), (1 if rows > 0 else -1), columns / abs(rows)
            else:
                reach, next_right, next_slope = abs(columns), (1 if columns > 0 else -1), rows / abs(columns)
            if next_down == down and next_right == right:
                together, apart = min(length[top], reach), abs(next_slope - slope)
                if together * apart > 1.0:
                    together = int(1.0 / apart)
        while length[top] > together:  # what goes farther than the next line is beside it ends here
            begin = max(length[top - 1], together)
            steps[count, 0], steps[count, 1], steps[count, 2], steps[count, 3] = begin, length[top], down, right
            slopes[count, 0], slopes[count, 1] = least[top], greatest[top]
            count += 1
            if length[top - 1] < together:
                length[top] = together
            else:
                top -= 1
                least[top], greatest[top] = min(least[top], least[top + 1]), max(greatest[top], greatest[top + 1])
        down, right, slope = next_down, next_right, next_slope
        if reach > length[top]:
            top += 1
            length[top], least[top], greatest[top] = reach, slope, slope
        else:
            least[top], greatest[top] = min(least[top], slope), max(greatest[top], slope)
    return steps[:count], slopes[:count]


@kernel()
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

    Line after line would visit the cells near the lidar again and again; bundles of lines visit them about once.
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
    steps, slopes = bundles(cells)
    for n in range(len(steps)):
        begin, end, down, right = steps[n, 0], steps[n, 1], steps[n, 2], steps[n, 3]
        along, across = down * columns + right, (1 if right == 0 else columns)
        for k in range(begin, end):
            first, last = slopes[n, 0] * k, slopes[n, 1] * k
            first, last = first + math.copysign(BELOW_HALF, first), last + math.copysign(BELOW_HALF, last)
            for side in range(int(first), int(last) + 1):  # rounded, halves towards 0: Bresenham's cells
                i = np.uint64(start + k * along + side * across)
                if seen[i] != this:
                    seen[i] = this
                    values[i] = max(values[i] - miss, -bound)
                    above[i] = values[i] > threshold


@kernel("i8[:, ::1]")
def scan_cells(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Every cell (n, 2) that :func:`write_scan` takes a miss from, some of them several times, and some of them ends.

    For scans that reach further than a grid does: ``cells`` (m + 1, 2) are as there, and so are the answers.
    """
    steps, slopes = bundles(cells)
    found = np.empty((1024, 2), np.int64)
    count = 0
    for n in range(len(steps)):
        for k in range(steps[n, 0], steps[n, 1]):
            first, last = slopes[n, 0] * k, slopes[n, 1] * k
            first, last = first + math.copysign(BELOW_HALF, first), last + math.copysign(BELOW_HALF, last)
            for side in range(int(first), int(last) + 1):
                if count == len(found):
                    more = np.empty((2 * count, 2), np.int64)
                    for i in range(count):
                        more[i, 0], more[i, 1] = found[i, 0], found[i, 1]
                    found = more
                down, right = steps[n, 2], steps[n, 3]
                found[count, 0] = cells[0, 0] + k * down + (side if down == 0 else 0)
                found[count, 1] = cells[0, 1] + k * right + (side if right == 0 else 0)
                count += 1
    return found[:count]


@kernel("f4[:, ::1], i8, i8, i8")
def known_tiles(values: NDArray[np.float32], above: int, before: int, size: int) -> NDArray[np.bool_]:
    """Which tiles, ``size`` cells wide, of an array hold a cell that is not 0.

    The array's first row is row ``above`` of the first tiles, its first column their column ``before``.
    """
    rows, columns = values.shape
    out = np.zeros(((rows + above - 1) // size + 1, (columns + before - 1) // size + 1), np.bool_)
    for i in range(rows):
        down = (i + above) // size
        for right in range(out.shape[1]):
            if out[down, right]:
                continue
            known = False
            for j in range(max(right * size - before, 0), min((right + 1) * size - before, columns)):
                known |= values[i, j] != np.float32(0.0)
            out[down, right] = known
    return out


@kernel()
def _fits(extent: NDArray[np.int64], grid: NDArray[np.float32], origin_row: int, origin_column: int) -> bool:
    """Whether an ``extent`` (4,), as of :func:`end_cells`, lies within the ``grid``'s outermost ring."""
    rows, columns = grid.shape
    fits: bool = (
        extent[0] + origin_row >= 1
        and extent[1] + origin_column >= 1
        and extent[2] + origin_row <= rows - 2
        and extent[3] + origin_column <= columns - 2
    )
    return fits


@kernel("f8[::1], f8[:, ::1], f8[::1], f4[:, ::1], u1[:, ::1], u1[:, ::1], i8, i8, i8, f8, f4, f4, f4, f4")
def add_scan(
    pose: Floats,
    points: Floats,
    lidar_position: Floats,
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
    cells, extent, world = end_cells(pose, points, lidar_position, cell)
    inside = _fits(extent, log_odds, origin_row, origin_column)
    if inside:
        write_scan(log_odds, occupied, touched, mark, cells, origin_row, origin_column, hit, miss, bound, threshold)
    return inside, extent, world


@kernel(
    "f8[:, ::1], f8[:, ::1], i8[::1], f8[:, ::1], i8, f4[:, ::1], u1[:, ::1], u1[:, ::1], i8, "
    "i8, i8, f8, f4, f4, f4, f4"
)
def add_scans(
    poses: Floats,
    points: Floats,
    first: NDArray[np.int64],
    lidar_positions: Floats,
    done: int,
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
) -> tuple[int, NDArray[np.int64]]:
    """:func:`add_scan` from scan ``done`` on, until one does not fit; how many are done then, and that one's extent.

    Scan k is seen from ``poses[k]`` of (n, 3) with the lidar at ``lidar_positions[k]`` of (n, 2); rows ``first[k]`` to
    ``first[k + 1]`` of ``points`` are its. ``mark`` to ``mark + n - 1`` must be new to ``touched``; the rest is as for
    :func:`add_scan`, which is written out here, as a call of it takes half a second to compile.
    """
    extent = np.zeros(4, np.int64)
    for k in range(done, len(poses)):
        cells, extent, _ = end_cells(poses[k], points[first[k] : first[k + 1]], lidar_positions[k], cell)
        if not _fits(extent, log_odds, origin_row, origin_column):
            return k, extent
        write_scan(log_odds, occupied, touched, mark + k, cells, origin_row, origin_column, hit, miss, bound, threshold)
    return len(poses), extent
