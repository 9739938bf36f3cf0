"""The loops over the pixels of a frame, and over the cells that they fell into."""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.texture.kinect import INVERSE_AT_0, INVERSE_STEP, SCALE

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

BINS, STEPS = 256, 92.0  # of the histogram of log gains: each 1.1 %, together from 1/4 to 4
DARKEST, BRIGHTEST = 12.0, 245.0  # of 255: what is outside says little of the exposure, or is cut off
FEWEST_PIXELS = 4.0  # that a cell must have in a frame to be compared
MOST_PIXELS = 64.0  # beyond which a cell says no more of the exposure
EVERY = 2  # rows and columns of cells: others are not compared
FEW_CELLS = 5.0  # so many make half of the gain that they say: their colours may differ for another reason
LEAK = 0.1  # of a log gain is left out, times the share of the frame's floor that is new


@kernel(
    "f4[:, :, ::1], i8, i8, f8, u2[:, ::1], u1[:, :, ::1], f8, f8, f8, f8, f4[:, ::1], f4[:, ::1], f8[::1], f8, f8, "
    "f4[::1], i4[::1], f4[::1]",
    error_model="numpy",
)  # divisions that need no check are vectorised
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
    color_columns: Float32,
    color_rows: NDArray[np.int32],
    color_shift: Float32,
):
    """Sum up one frame's floor pixels by cell; both images from the view's first rows on.

    ``patch`` (n, n, 4) float32, all 0, gets per cell the sums of red, green and blue, and the number of pixels. Its
    cell [0, 0] is ``top``, ``left``, counted from the world origin's cell. ``x``, ``y``, ``cos``, ``sin`` are the
    robot's pose, the arguments from ``by_row`` on a :class:`~pfslam_viz.texture.kinect.FloorView`'s. Answers the first
    and last row and column that were touched (last < first: none).
    """
    cells = patch.reshape(-1, 4)
    size, columns, width = np.int32(len(patch)), disparity.shape[1], np.int32(color.shape[1])
    box_top, box_bottom, box_left, box_right = size, np.int32(-1), size, np.int32(-1)
    # A pixel's cell is (down, right) + depth * (its ray, turned), in cells; positive within the patch.
    turn_x, turn_y = np.float32(cos / cell), np.float32(sin / cell)
    right = np.float32((x + cos * position[0] - sin * position[1]) / cell - left)
    down = np.float32(-(y + sin * position[0] + cos * position[1]) / cell - top)
    least, most = np.float32(position[2] - tolerance), np.float32(position[2] + tolerance)  # below the camera
    farthest, none, one = np.float32(max_range), np.int32(-1), np.int32(1)
    at_zero, per_step, scale = np.float32(INVERSE_AT_0), np.float32(INVERSE_STEP), np.float32(SCALE)
    depth = np.empty(columns, np.float32)
    rounding = np.float32(1.5)  # and then one less: conversion cuts towards zero
    row, column = np.empty(columns, np.int32), np.empty(columns, np.int32)
    index, color_column = np.empty(columns, np.int32), np.empty(columns, np.int32)
    # Neighbours often fall into one cell: sums wait in registers until the next cell comes.
    nothing: int = np.int64(0)  # type: ignore[assignment]  # of the sums' type from the first
    here, red, green, blue, count = none, nothing, nothing, nothing, nothing
    for v in range(len(disparity)):
        if color_rows[v] < 0 or color_rows[v] >= len(color):
            continue
        raw, shown, ray = disparity[v], color[color_rows[v]], by_row[v]
        for u in range(columns):  # vectorised by the compiler, which is why pixels that are no floor are not skipped
            depth[u] = scale / (at_zero + per_step * np.float32(raw[u]))
            ahead = depth[u] * (ray[0] + by_column[0, u])
            side = depth[u] * (ray[1] + by_column[1, u])
            below = -depth[u] * (ray[2] + by_column[2, u])
            row[u] = np.int32(down - (turn_y * ahead + turn_x * side))
            column[u] = np.int32(right + (turn_x * ahead - turn_y * side))
            shift = color_shift[0] + color_shift[1] * np.float32(raw[u])
            color_column[u] = np.int32(color_columns[u] - shift + rounding) - one
            floor = (depth[u] > 0.0) & (below >= least) & (below <= most) & (ahead <= farthest)
            # Unsigned, what is negative is beyond the end.
            inside = (np.uint32(row[u]) < np.uint32(size)) & (np.uint32(column[u]) < np.uint32(size))
            colored = np.uint32(color_column[u]) < np.uint32(width)
            index[u] = row[u] * size + column[u] if floor & inside & colored else none
        for u in range(columns):
            if index[u] < 0:
                continue
            if index[u] != here:
                if count > 0:
                    _put(cells[here], red, green, blue, count)
                here = index[u]
                red, green, blue, count = nothing, nothing, nothing, nothing
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


@kernel()
def _put(sums: Float32, red: int, green: int, blue: int, count: int) -> None:
    sums[0] += np.float32(red)
    sums[1] += np.float32(green)
    sums[2] += np.float32(blue)
    sums[3] += np.float32(count)


@kernel("f4[:, :, :], f4[:, :, :], f4[:, :], u1[:, :, :]")
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


@kernel("f4[:, :, :], f4[:, :, :], f4[:, :]")
def match(patch: Float32, total: Float32, weight: Float32) -> Array:
    """What a frame's colours are to be multiplied by (3,), red, green and blue, to look like what is painted already.

    Arrays as in :func:`merge`. Each channel's gain is the weighted median of painted over seen, in logarithms, over
    the cells that both have: half of the cells may show something else, or another part of a tile. A channel without
    such cells has the others' gain. Gains chain from frame to frame, and so would their errors, did not :data:`LEAK`
    draw new floor to the exposure that it is seen with: after some ten views' worth of it they are forgotten.
    """
    votes, cells, logs = np.zeros((3, BINS), np.float32), np.zeros(3), np.zeros(3)
    middle, new, old = 0.5 * BINS, 0, 0
    for i in range(0, patch.shape[0], EVERY):
        for j in range(0, patch.shape[1], EVERY):
            count = patch[i, j, 3]
            if count < FEWEST_PIXELS:
                continue
            if weight[i, j] == 0.0:
                new += 1
                continue
            old += 1
            a_pixel, a_weight = np.float32(1.0) / count, np.float32(1.0) / weight[i, j]
            for k in range(3):
                seen, painted = patch[i, j, k] * a_pixel, total[i, j, k] * a_weight
                if seen < DARKEST or seen > BRIGHTEST or painted < DARKEST:
                    continue
                step = math.floor(STEPS * math.log(painted / seen) + middle)
                if 0 <= step < BINS:
                    votes[k, step] += min(count, MOST_PIXELS)
                    cells[k] += 1.0
    kept = 1.0 - LEAK * new / max(new + old, 1)
    for k in range(3):
        together, below = np.float32(0.0), 0.0
        for step in range(BINS):
            together += votes[k, step]
        half = 0.5 * together
        for step in range(BINS):
            if half > 0.0 and below + votes[k, step] >= half:
                log = (step + (half - below) / votes[k, step] - middle) / STEPS
                logs[k] = log * kept * cells[k] / (cells[k] + FEW_CELLS)
                break
            below += votes[k, step]
    known, others = 0, 0.0
    for k in range(3):
        if cells[k] > 0.0:
            known += 1
            others += logs[k]
    for k in range(3):
        if cells[k] == 0.0 and known > 0:
            logs[k] = others / known
        logs[k] = math.exp(logs[k])
    return logs


@kernel("f4[:, :, :], f8[::1], f4[:, :, :], f4[:, :], f4[:, :], u1[:, :, :]")
def blend(
    patch: Float32, gain: Array, total: Float32, weight: Float32, finest: Float32, color: NDArray[np.uint8]
) -> int:
    """Like :func:`merge`, the ``patch`` times ``gain`` (3,), but with close views overruling far ones.

    ``finest`` (r, c) is the most pixels that a cell got in one frame. A frame with less than half as many is too coarse
    for the cell, however often it comes; others weigh their pixels, less in proportion where they have fewer than the
    finest. When a finer one comes, earlier ones together weigh no more than one, less in proportion, and nothing if
    they are too coarse now. Answers how many cells were seen.
    """
    touched, red, green, blue = 0, np.float32(gain[0]), np.float32(gain[1]), np.float32(gain[2])
    zero, half, one, most = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(255.5)
    for i in range(patch.shape[0]):
        for j in range(patch.shape[1]):
            count, best = patch[i, j, 3], finest[i, j]
            if count == 0.0:
                continue
            touched += 1
            if count < half * best:
                continue
            here, before = count / max(best, count), one
            if count > best:
                before = min(best / weight[i, j], one) * best / count if best >= half * count else zero
                finest[i, j] = count
            weight[i, j] = before * weight[i, j] + here * count
            total[i, j, 0] = before * total[i, j, 0] + here * red * patch[i, j, 0]
            total[i, j, 1] = before * total[i, j, 1] + here * green * patch[i, j, 1]
            total[i, j, 2] = before * total[i, j, 2] + here * blue * patch[i, j, 2]
            share = one / weight[i, j]
            for k in range(3):
                color[i, j, k] = np.uint8(min(total[i, j, k] * share + half, most))
    return touched


@kernel("u2[:, ::1], f4[:, ::1], f4[:, ::1], f8, f8, f8, f8, i8", error_model="numpy")
def off_plane(  # type: ignore[no-untyped-def]
    disparity: NDArray[np.uint16],
    by_row: Float32,
    by_column: Float32,
    height: float,
    max_range: float,
    tolerance: float,
    slope: float,
    every: int,
):
    """How many of every ``every``-th pixel lie on the floor (within ``tolerance`` m), near it, and about it.

    Near: within three times that. About: within so much, and ``slope`` m more for each m of depth. No farther ahead
    than ``max_range`` m. Arguments as in :func:`collect`, ``height`` is the camera's.
    """
    on, near, about = 0, 0, 0
    for v in range(every // 2, disparity.shape[0], every):
        for u in range(every // 2, disparity.shape[1], every):
            depth = SCALE / (INVERSE_AT_0 + INVERSE_STEP * disparity[v, u])
            if depth <= 0.0 or depth * (by_row[v, 0] + by_column[0, u]) > max_range:
                continue
            off = abs(height + depth * (by_row[v, 2] + by_column[2, u]))
            on += off <= tolerance
            near += off <= 3.0 * tolerance
            about += off <= 3.0 * tolerance + slope * depth
    return on, near, about
