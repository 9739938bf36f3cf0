"""Where a view fits on a map, over a wide window, without looking at every offset.

Offsets are taken in blocks; on a map in which every cell holds the greatest value of the block that begins there, one
look bounds the scores of a whole block from above, so that only blocks that can still win are searched (Olson 2015,
"M3RSM: Many-to-many multi-resolution scan matching"; the branch and bound of Hess et al. 2016, with two levels).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel

Array = NDArray[np.float64]
Field = NDArray[np.float32]

BLOCK = 4  # cells along the edge of a block of offsets


@dataclass(frozen=True, slots=True)
class Fit:
    """The best ``score`` in [0, 1], at the number ``turn`` of the turns, moved by ``row`` and ``column`` cells.

    ``rival`` is the best score of all that lie apart from it, or less than what was asked for as a bound.
    """

    score: float
    turn: int
    row: int
    column: int
    rival: float


def search(
    field: Field, centre: Array, points: Array, turns: Array, steps: int, *, least: float, share: float, apart: float
) -> Fit | None:
    """Where ``points`` (m, 2), turned about ``centre`` (2,) and moved by up to +-``steps`` cells, fit best; or None.

    All in cells. A score is the mean of the ``field`` (n, n) under the points, those that leave it counting 0. None if
    no score reaches ``least``. Scores from ``share`` of the best one on are known exactly for the rival, which lies at
    least ``apart`` cells away.
    """
    sums = _sums(_block_maxima(field), centre, points, turns, steps, BLOCK)
    bounds = sums.astype(np.float64) / len(points)
    order = np.argsort(-bounds, axis=None)
    blocks = np.stack(np.unravel_index(order, bounds.shape), axis=-1)
    found = _refine(field, centre, points, turns, steps, bounds.ravel()[order], blocks, least, share)
    if len(found) == 0:
        return None
    best = int(np.argmax(found[:, 0]))
    score, turn, row, column = found[best]
    if score < least:
        return None
    others = found[(found[:, 2] - row) ** 2 + (found[:, 3] - column) ** 2 > apart**2, 0]
    return Fit(float(score), int(turn), int(row), int(column), float(others.max(initial=0.0)))


def _block_maxima(field: Field) -> Field:
    """Of every cell, the greatest value of the block whose first row and column it is."""
    import cv2

    kernel = np.ones((BLOCK, BLOCK), np.uint8)
    dilated = cv2.dilate(field, kernel, anchor=(0, 0), borderType=cv2.BORDER_CONSTANT, borderValue=0.0)
    return np.asarray(dilated, np.float32)


@kernel("f4[:, ::1], f8[::1], f8[:, ::1], f8[::1], i8, i8")
def _sums(field: Field, centre: Array, points: Array, turns: Array, steps: int, stride: int) -> Field:
    """Sums of the field under the points at every ``stride``-th offset: (turns, k, k), rows are shifts along y."""
    n = field.shape[0]
    width = (2 * steps) // stride + 1
    out = np.zeros((len(turns), width, width), np.float32)
    for t in range(len(turns)):
        c, s = math.cos(turns[t]), math.sin(turns[t])
        for b in range(len(points)):
            column = math.floor(centre[0] + c * points[b, 0] - s * points[b, 1]) - steps
            row = math.floor(centre[1] + s * points[b, 0] + c * points[b, 1]) - steps
            first_i, first_j = max(0, -(row // stride)), max(0, -(column // stride))  # ceil(-row / stride)
            last_i, last_j = min(width, (n - 1 - row) // stride + 1), min(width, (n - 1 - column) // stride + 1)
            for i in range(first_i, last_i):
                for j in range(first_j, last_j):
                    out[t, i, j] += field[row + stride * i, column + stride * j]
    return out


@kernel("f4[:, ::1], f8[::1], f8[:, ::1], f8[::1], i8, f8[::1], i8[:, ::1], f8, f8")
def _refine(
    field: Field,
    centre: Array,
    points: Array,
    turns: Array,
    steps: int,
    bounds: Array,
    blocks: NDArray[np.int64],
    least: float,
    share: float,
) -> Array:
    """(k, 4) score, turn, shift along y and x in cells, of all offsets in blocks (b, 3) whose bound can still matter.

    ``bounds`` (b,) fall.
    """
    n, m = field.shape[0], len(points)
    out = np.empty((64, 4))
    count, best = 0, 0.0
    columns, rows = np.empty(m, np.int64), np.empty(m, np.int64)
    for k in range(len(bounds)):
        if bounds[k] < least or bounds[k] < share * best:
            break
        t, i, j = blocks[k, 0], blocks[k, 1], blocks[k, 2]
        c, s = math.cos(turns[t]), math.sin(turns[t])
        for b in range(m):
            columns[b] = math.floor(centre[0] + c * points[b, 0] - s * points[b, 1])
            rows[b] = math.floor(centre[1] + s * points[b, 0] + c * points[b, 1])
        for di in range(BLOCK):
            for dj in range(BLOCK):
                down, right = BLOCK * i + di - steps, BLOCK * j + dj - steps
                if down > steps or right > steps:
                    continue
                total = 0.0
                for b in range(m):
                    row, column = rows[b] + down, columns[b] + right
                    if 0 <= row < n and 0 <= column < n:
                        total += field[row, column]
                if count == len(out):
                    more = np.empty((2 * count, 4))
                    for f in range(count):
                        for column in range(4):
                            more[f, column] = out[f, column]
                    out = more
                out[count, 0], out[count, 1], out[count, 2], out[count, 3] = total / m, t, down, right
                best = max(best, total / m)
                count += 1
    return out[:count]
