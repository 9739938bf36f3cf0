"""What is drawn of every scan or map, worked out cell by cell: compiled by numba, arrays in and arrays out."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Positions = NDArray[np.float32]


@njit(cache=True, nogil=True)
def known_box(values: NDArray[np.float32]) -> NDArray[np.int64]:
    """First row, last row, first column and last column (4,) of the ``values`` that are not 0; where all are, all 0."""
    rows, columns = values.shape
    box = np.array([rows, -1, columns, -1])
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
    return box if box[1] >= 0 else np.zeros_like(box)


@njit(cache=True, nogil=True)
def shade(
    log_odds: NDArray[np.float32], table: NDArray[np.uint8], steps: float, unknown: int
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """The :func:`known_box` of a map, and each of its cells' entry in ``table`` (256,), (rows, columns) of the box.

    An entry stands for 1 / ``steps`` of log-odds, 0 in the middle; cells whose log-odds are 0 become ``unknown``.
    """
    box = known_box(log_odds)
    rows, columns = box[1] - box[0] + 1, box[3] - box[2] + 1
    out = np.full((rows, columns), np.uint8(unknown))
    for i in range(rows):
        for j in range(columns):
            value = log_odds[box[0] + i, box[2] + j]
            if value != 0.0:
                out[i, j] = table[int(min(max(value * steps + 128.5, 0.0), 255.0))]
    return out, box


@njit(cache=True, nogil=True)
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
    alive = particles.copy()
    for _ in range((count - 1) // stride):
        older = (row - stride) % window
        drawn, survivors = np.zeros(n, np.bool_), 0
        for k in range(len(alive)):
            ancestor = alive[k]
            for back in range(stride):
                ancestor = parents[(row - back) % window, ancestor]
            for axis in range(2):
                pieces[m, 0, axis], pieces[m, 1, axis] = (
                    positions[older, ancestor, axis],
                    positions[row, alive[k], axis],
                )
            m += 1
            if not drawn[ancestor]:
                drawn[ancestor] = True
                alive[survivors] = ancestor
                survivors += 1
        alive, row = alive[:survivors], older
    return pieces[:m]
