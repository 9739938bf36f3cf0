"""The loops over the cells of maps that share tiles: compiled by numba, arrays in and arrays out.

Everywhere ``table`` (rows, columns) holds the tile at each place of one map, ``log_odds`` and ``field`` (tiles, 32, 32)
what the tiles hold, as in :class:`pfslam_viz.slam.rbpf.tile_maps.TileMaps`; ``references`` (tiles,) counts the places
of all maps that hold a tile, ``free`` and its count are the stack of tiles that none holds. A map's cell (row, column)
is (row & LOW, column & LOW) of the tile at (row >> BITS, column >> BITS). The plain twin, a dictionary of cells for
each map, is in ``tests/slam/rbpf/test_tile_maps.py``.
"""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.kernels import transform

Floats = NDArray[np.float64]
Field = NDArray[np.float32]
Index = NDArray[np.int32]

BITS = 5
SIZE = 1 << BITS  # cells along a tile's edge
LOW = SIZE - 1


@kernel("i4[:, ::1], f4[:, :, ::1], i8[::1], f8, f4, f8[::1], f8[:, ::1]")
def project(
    table: Index,
    log_odds: Field,
    origin: NDArray[np.int64],
    cell: float,
    threshold: np.float32,
    pose: Floats,
    points: Floats,
) -> tuple[Floats, NDArray[np.bool_]]:
    """End points (m, 2) in the world from one pose, (23), and whether each falls on an occupied cell of one map."""
    world, hits = transform(pose, points), np.zeros(len(points), np.bool_)
    rows, columns = table.shape[0] << BITS, table.shape[1] << BITS
    for b in range(len(points)):
        i, j = math.floor(-world[b, 1] / cell) + origin[0], math.floor(world[b, 0] / cell) + origin[1]
        if 0 <= i < rows and 0 <= j < columns:
            hits[b] = log_odds[table[i >> BITS, j >> BITS], i & LOW, j & LOW] > threshold
    return world, hits


@kernel()
def _own(
    table: Index,
    log_odds: Field,
    field: Field,
    references: Index,
    free: Index,
    count: NDArray[np.int64],
    row: int,
    column: int,
) -> int:
    """The tile at a place of one map, copied first if other places hold it too: copy on write."""
    tile: int = table[row, column]
    if tile != 0 and references[tile] == 1:
        return tile
    count[0] -= 1
    new: int = free[count[0]]
    for i in range(SIZE):
        for j in range(SIZE):
            log_odds[new, i, j], field[new, i, j] = log_odds[tile, i, j], field[tile, i, j]
    references[tile] -= 1
    references[new] = 1
    table[row, column] = new
    return new


@kernel(
    "i4[:, :, ::1], f4[:, :, ::1], f4[:, :, ::1], i4[::1], i4[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[::1], "
    "i8[::1], f8, f4[:, ::1], f8, f8, f8, f4, i8, i8"
)
def write_scans(
    table: Index,
    log_odds: Field,
    field: Field,
    references: Index,
    free: Index,
    free_count: NDArray[np.int64],
    poses: Floats,
    points: Floats,
    lidar_position: Floats,
    origin: NDArray[np.int64],
    cell: float,
    kernel: Field,
    hit: float,
    miss: float,
    bound: float,
    threshold: np.float32,
    stride: int,
    first: int,
) -> int:
    """Write one scan into every map from ``first`` on; how many maps are done when the free tiles run short.

    Cells with an end point gain ``hit``, those of the Bresenham line up to every ``stride``-th of them lose ``miss``,
    once for every line; that is why lines are not bundled as in :mod:`pfslam_viz.slam.map_kernels`, where a cell
    changes once a scan. Cells above the ``threshold`` are occupied; ``kernel`` (2 r + 1, 2 r + 1) is the field round
    one of them.
    """
    m, reach = len(points), kernel.shape[0] // 2
    appeared = np.empty((m, 2), np.int64)
    vanished = np.empty((4 * m + 1024, 2), np.int64)
    ends = np.empty((m, 2), np.int64)
    for p in range(first, len(poses)):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        x, y = poses[p, 0], poses[p, 1]
        start_row = math.floor(-(y + s * lidar_position[0] + c * lidar_position[1]) / cell) + origin[0]
        start_column = math.floor((x + c * lidar_position[0] - s * lidar_position[1]) / cell) + origin[1]
        low_row, high_row, low_column, high_column = start_row, start_row, start_column, start_column
        for b in range(m):
            row = math.floor(-(y + s * points[b, 0] + c * points[b, 1]) / cell) + origin[0]
            column = math.floor((x + c * points[b, 0] - s * points[b, 1]) / cell) + origin[1]
            ends[b, 0], ends[b, 1] = row, column
            low_row, high_row = min(low_row, row), max(high_row, row)
            low_column, high_column = min(low_column, column), max(high_column, column)
        tiles = (((high_row + reach) >> BITS) - ((low_row - reach) >> BITS) + 1) * (
            ((high_column + reach) >> BITS) - ((low_column - reach) >> BITS) + 1
        )
        if free_count[0] < tiles:
            return p
        mine = table[p]
        n_vanished = n_appeared = 0
        for b in range(0, m, stride):  # free space first: what a beam ends on must outlast what grazes it
            row, column = start_row, start_column
            rows, columns = abs(ends[b, 0] - row), abs(ends[b, 1] - column)
            down = 1 if ends[b, 0] >= row else -1
            right = 1 if ends[b, 1] >= column else -1
            error = columns - rows
            tile_row, tile_column, tile = -1, -1, 0
            for _ in range(max(rows, columns)):
                if row >> BITS != tile_row or column >> BITS != tile_column:
                    tile_row, tile_column = row >> BITS, column >> BITS
                    tile = _own(mine, log_odds, field, references, free, free_count, tile_row, tile_column)
                i, j = row & LOW, column & LOW
                before = log_odds[tile, i, j]
                if before > -bound:
                    after = np.float32(max(before - miss, -bound))
                    log_odds[tile, i, j] = after
                    if before > threshold and after <= threshold and n_vanished < len(vanished):
                        vanished[n_vanished, 0], vanished[n_vanished, 1] = row, column
                        n_vanished += 1
                twice = 2 * error
                if twice > -rows:
                    error -= rows
                    column += right
                if twice < columns:
                    error += columns
                    row += down
        for b in range(m):
            row, column = ends[b, 0], ends[b, 1]
            tile = _own(mine, log_odds, field, references, free, free_count, row >> BITS, column >> BITS)
            i, j = row & LOW, column & LOW
            before = log_odds[tile, i, j]
            after = np.float32(min(before + hit, bound))
            log_odds[tile, i, j] = after
            if before <= threshold and after > threshold:
                appeared[n_appeared, 0], appeared[n_appeared, 1] = row, column
                n_appeared += 1
        for k in range(n_vanished):
            _erase(
                mine, log_odds, field, references, free, free_count, vanished[k, 0], vanished[k, 1], kernel, threshold
            )
        for k in range(n_appeared):
            _stamp(mine, log_odds, field, references, free, free_count, appeared[k, 0], appeared[k, 1], kernel)
    return len(poses)


@kernel()
def _stamp(
    table: Index,
    log_odds: Field,
    field: Field,
    references: Index,
    free: Index,
    count: NDArray[np.int64],
    row: int,
    column: int,
    kernel: Field,
) -> None:
    """A cell became occupied: raise the field round it."""
    reach = kernel.shape[0] // 2
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            value = kernel[i + reach, j + reach]
            r, c = row + i, column + j
            if value > field[table[r >> BITS, c >> BITS], r & LOW, c & LOW]:
                tile = _own(table, log_odds, field, references, free, count, r >> BITS, c >> BITS)
                field[tile, r & LOW, c & LOW] = value


@kernel()
def _erase(
    table: Index,
    log_odds: Field,
    field: Field,
    references: Index,
    free: Index,
    count: NDArray[np.int64],
    row: int,
    column: int,
    kernel: Field,
    threshold: np.float32,
) -> None:
    """A cell became free: find the field anew where it was the nearest occupied one."""
    if log_odds[table[row >> BITS, column >> BITS], row & LOW, column & LOW] > threshold:
        return  # an end point of the same scan has put it back
    reach = kernel.shape[0] // 2
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            r, c = row + i, column + j
            now = field[table[r >> BITS, c >> BITS], r & LOW, c & LOW]
            if now > kernel[i + reach, j + reach] or now == 0.0:
                continue
            best = np.float32(0.0)
            for a in range(-reach, reach + 1):
                for b in range(-reach, reach + 1):
                    if kernel[a + reach, b + reach] > best:
                        u, v = r + a, c + b
                        if log_odds[table[u >> BITS, v >> BITS], u & LOW, v & LOW] > threshold:
                            best = kernel[a + reach, b + reach]
            if best != now:
                tile = _own(table, log_odds, field, references, free, count, r >> BITS, c >> BITS)
                field[tile, r & LOW, c & LOW] = best


@kernel(fastmath=True)
def agreement(
    table: Index,
    field: Field,
    origin: NDArray[np.int64],
    cell: float,
    points: Floats,
    x: float,
    y: float,
    heading: float,
) -> float:
    """Sum over end points (m, 2) of one map's field, bilinear between cell centres, for the pose (x, y, heading)."""
    c, s = math.cos(heading) / cell, math.sin(heading) / cell
    left, top = x / cell + origin[1] - 0.5, origin[0] - y / cell - 0.5
    rows, columns = (table.shape[0] << BITS) - 1, (table.shape[1] << BITS) - 1
    total = 0.0
    for b in range(len(points)):
        u = left + c * points[b, 0] - s * points[b, 1]
        v = top - s * points[b, 0] - c * points[b, 1]
        if u < 0.0 or v < 0.0 or u >= columns or v >= rows:
            continue
        j, i = int(u), int(v)
        fu, fv = u - j, v - i
        tile = table[i >> BITS, j >> BITS]
        a, d = i & LOW, j & LOW
        if a < LOW and d < LOW:
            if tile == 0:
                continue
            upper = field[tile, a, d] + fu * (field[tile, a, d + 1] - field[tile, a, d])
            lower = field[tile, a + 1, d] + fu * (field[tile, a + 1, d + 1] - field[tile, a + 1, d])
        else:
            i2, j2 = i + 1, j + 1
            f00 = field[tile, a, d]
            f01 = field[table[i >> BITS, j2 >> BITS], a, j2 & LOW]
            f10 = field[table[i2 >> BITS, j >> BITS], i2 & LOW, d]
            f11 = field[table[i2 >> BITS, j2 >> BITS], i2 & LOW, j2 & LOW]
            upper = f00 + fu * (f01 - f00)
            lower = f10 + fu * (f11 - f10)
        total += upper + fv * (lower - upper)
    return total
