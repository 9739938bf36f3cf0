"""What is drawn of every scan or map, worked out cell by cell: compiled by numba, arrays in and arrays out."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel

Positions = NDArray[np.float32]


@kernel()
def known_cells(values: NDArray[np.float32]) -> NDArray[np.int64]:
    """First row, last row, first column and last column (4,) of the ``values`` that are not 0; where all are, all 0."""
    rows, columns = values.shape
    box = np.empty(4, np.int64)
    box[0], box[1], box[2], box[3] = rows, -1, columns, -1
    in_column = np.zeros(columns, np.bool_)
    for i in range(rows):
        in_row = False
        for j in range(columns):  # vectorised by the compiler
            known = values[i, j] != np.float32(0.0)
            in_column[j] |= known
            in_row |= known
        if in_row:
            box[0], box[1] = min(box[0], i), i
    for j in range(columns):
        if in_column[j]:
            box[2], box[3] = min(box[2], j), j
    if box[1] < 0:
        box[0], box[1], box[2], box[3] = 0, 0, 0, 0
    return box


@kernel("f4[:, ::1], u1[::1], f8, i8", fastmath={"nnan"})  # so that least and greatest are vectorised
def shade(
    log_odds: NDArray[np.float32], table: NDArray[np.uint8], steps: float, unknown: int
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """The :func:`known_cells` of a map, and each of its cells' entry in ``table`` (256,), (rows, columns) of the box.

    An entry stands for 1 / ``steps`` of log-odds, 0 in the middle; cells whose log-odds are 0 become ``unknown``.
    """
    box = known_cells(log_odds)
    rows, columns = box[1] - box[0] + 1, box[3] - box[2] + 1
    out, levels = np.empty((rows, columns), np.uint8), np.empty(columns, np.int32)
    zero, middle, highest, scale = np.float32(0.0), np.float32(128.5), np.float32(255.0), np.float32(steps)
    other = np.uint8(unknown)
    for i in range(rows):
        line = log_odds[box[0] + i, box[2] : box[3] + 1]
        for j in range(columns):
            levels[j] = np.int32(min(max(line[j] * scale + middle, zero), highest))
        for j in range(columns):
            out[i, j] = table[np.uint32(levels[j])] if line[j] != zero else other
    return out, box


@kernel("u4[:, :, ::1], i8[::1]")
def fingerprints(pool: NDArray[np.uint32], index: NDArray[np.int64]) -> NDArray[np.uint32]:
    """A number for each of the tiles ``index`` (k,) of a ``pool`` (n, s, s) that changes with any of its cells."""
    out = np.empty(len(index), np.uint32)
    odd = np.uint32(2654435769)  # 2^32 over the golden ratio
    for k in range(len(index)):
        tile = pool[index[k]]
        total = np.uint32(0)
        for i in range(tile.shape[0]):
            place = np.uint32(i * 40503 + 1)
            for j in range(tile.shape[1]):  # vectorised by the compiler
                bits = tile[i, j] ^ (tile[i, j] >> np.uint32(15))
                total += np.uint32(bits * (place + np.uint32(j) * np.uint32(2) | np.uint32(1)) * odd)
        out[k] = total
    return out


@kernel("u1[:, ::1], u1[:, ::1], i8, i8, i8, i8")
def bridge(
    cells: NDArray[np.uint8], drawn: NDArray[np.uint8], most: int, free: int, unknown: int, tint: int
) -> NDArray[np.uint8]:
    """``drawn`` (rows, columns) with ``tint`` where the ``cells`` are ``unknown`` in a gap between two rays.

    That is a run of at most ``most`` of them, along a row or a column, between two cells below ``free``.
    """
    rows, columns = cells.shape
    out = np.empty(drawn.shape, np.uint8)
    for i in range(rows):
        for j in range(columns):
            out[i, j] = drawn[i, j]
    above = np.empty(columns, np.int64)  # the last row that was free with nothing but unknown since, if any
    for j in range(columns):
        above[j] = -1
    for i in range(rows):
        before = -1
        for j in range(columns):
            value = cells[i, j]
            if value == unknown:
                continue
            if value < free:
                if before >= 0 and 1 < j - before <= most + 1:
                    for k in range(before + 1, j):
                        out[i, k] = tint
                if above[j] >= 0 and 1 < i - above[j] <= most + 1:
                    for k in range(above[j] + 1, i):
                        out[k, j] = tint
                before, above[j] = j, i
            else:
                before = above[j] = -1
    return out


@kernel("i8[::1], i8[::1]")
def descend(founders: NDArray[np.int64], parents: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """The founders (N,) of the particles that descend from ``parents`` (N,), and how many different ones these are.

    ``founders`` (N,), in [0, N), are the parents' own. -1 different ones where a parent does not exist.
    """
    n = len(founders)
    own, met, count = np.empty(n, np.int64), np.zeros(n, np.bool_), 0
    for i in range(len(parents)):
        if not 0 <= parents[i] < n:
            return own, -1
        own[i] = founders[parents[i]]
        count += not met[own[i]]
        met[own[i]] = True
    return own, count


@kernel("f4[:, :, ::1], i4[:, ::1], i8, i8, i8[::1], i8")
def trace(
    positions: Positions, parents: NDArray[np.int32], newest: int, count: int, particles: NDArray[np.int64], stride: int
) -> Positions:
    """Pieces (m, 2, 2) of the ``particles``' lineages, each ``stride`` scans long, drawn once where they run together.

    ``positions`` (w, N, 2) and ``parents`` (w, N) are rings of which the last ``count`` rows up to ``newest`` hold
    scans: particle i there came from ``parents[row, i]`` in the row before.
    """
    window, n = parents.shape
    pieces = np.empty((max((count - 1) // stride, 0) * len(particles), 2, 2), np.float32)
    m, row = 0, newest
    alive = np.empty(len(particles), np.int64)
    for k in range(len(particles)):
        alive[k] = particles[k]
    for _ in range((count - 1) // stride):
        older = (row - stride) % window
        met, survivors = np.zeros(n, np.bool_), 0
        for k in range(len(alive)):
            ancestor = alive[k]
            for back in range(stride):
                ancestor = parents[(row - back) % window, ancestor]
            for axis in range(2):
                pieces[m, 0, axis] = positions[older, ancestor, axis]
                pieces[m, 1, axis] = positions[row, alive[k], axis]
            m += 1
            if not met[ancestor]:
                met[ancestor] = True
                alive[survivors] = ancestor
                survivors += 1
        alive, row = alive[:survivors], older
    return pieces[:m]
