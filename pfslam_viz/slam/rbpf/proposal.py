"""The improved proposal of Grisetti, Stachniss & Burgard (2007): match the scan, then look round the optimum.

A proposal is the distribution that a particle's new pose comes from. The plain one is the motion alone; the improved
one has seen the scan too. For every particle the posterior of the pose, log p(scan | map, pose) + log p(pose | motion),
is climbed from the pose by motion; poses sampled round the optimum then give its mean, where the particle goes, and the
evidence p(scan | map, motion), which weighs the particle. The plain twin of the search is in
``tests/slam/rbpf/test_proposal.py``.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.rbpf.tile_kernels import Field, Floats, Index, agreement


@kernel()
def _log_posterior(
    table: Index,
    field: Field,
    origin: NDArray[np.int64],
    cell: float,
    points: Floats,
    temper: float,
    guess: Floats,
    prior: Floats,
    x: float,
    y: float,
    heading: float,
) -> float:
    """Tempered log-likelihood of a scan plus log-prior, whose information in the guess's frame is ``prior`` (3, 3)."""
    c, s = math.cos(guess[2]), math.sin(guess[2])
    dx, dy = x - guess[0], y - guess[1]
    a, b, t = c * dx + s * dy, c * dy - s * dx, heading - guess[2]
    square: float = prior[0, 0] * a * a + prior[1, 1] * b * b + prior[2, 2] * t * t
    square += 2.0 * (prior[0, 1] * a * b + prior[0, 2] * a * t + prior[1, 2] * b * t)
    return temper * agreement(table, field, origin, cell, points, x, y, heading) - 0.5 * square


def window(covariance: NDArray[np.floating[Any]], apart: Floats, sigmas: float, most: int) -> NDArray[np.int64]:
    """How many starts (3,) there are to either side of the guess: as far as the motion is uncertain, ``most`` at most.

    That is ``sigmas`` standard deviations of its ``covariance`` (3, 3), in steps of ``apart`` (2,) m and rad; what is
    known better than a step is not searched.
    """
    steps = sigmas * np.sqrt(np.diag(covariance)) / apart[[0, 0, 1]]
    return np.minimum(steps, most).astype(np.int64)


@kernel()
def best_start(
    table: Index,
    field: Field,
    origin: NDArray[np.int64],
    cell: float,
    points: Floats,
    temper: float,
    guess: Floats,
    prior: Floats,
    starts: NDArray[np.int64],
    apart: Floats,
) -> Floats:
    """The best pose (3,) of a grid round the guess, from which to climb (Olson 2009).

    The grid has ``starts`` (3,) steps of ``apart`` (2,) m and rad to either side, in the guess's frame.
    """
    best = np.empty(3)
    best[0], best[1], best[2] = guess[0], guess[1], guess[2]
    top = _log_posterior(table, field, origin, cell, points, temper, guess, prior, guess[0], guess[1], guess[2])
    c, s = math.cos(guess[2]), math.sin(guess[2])
    for i in range(-starts[0], starts[0] + 1):
        for j in range(-starts[1], starts[1] + 1):
            x = guess[0] + apart[0] * (c * i - s * j)
            y = guess[1] + apart[0] * (s * i + c * j)
            for k in range(-starts[2], starts[2] + 1):
                heading = guess[2] + apart[1] * k
                value = _log_posterior(table, field, origin, cell, points, temper, guess, prior, x, y, heading)
                if value > top:
                    top = value
                    best[0], best[1], best[2] = x, y, heading
    return best


@kernel(
    "i4[:, :, ::1], f4[:, :, ::1], i8[::1], f8, f8[:, ::1], f8, f8[:, ::1], f8[:, ::1], i8[::1], f8[::1], f8[::1], "
    "i8, i8, f8[:, :, ::1], f8[::1]"
)
def propose(
    tables: Index,
    field: Field,
    origin: NDArray[np.int64],
    cell: float,
    points: Floats,
    temper: float,
    guesses: Floats,
    prior: Floats,
    starts: NDArray[np.int64],
    apart: Floats,
    steps: Floats,
    halvings: int,
    moves: int,
    normals: Floats,
    spread: Floats,
) -> tuple[Floats, Floats]:
    """Match and sample for every particle.

    ``guesses`` (N, 3) are the poses by motion alone, ``prior`` (3, 3) its information in the frame of the guess.
    The search starts from the :func:`best_start`, of ``starts`` (3,) to either side that are ``apart`` (2,) m and rad.
    It goes forth and back along x, y and heading in turn, at most ``moves`` times with one step; it
    starts with ``steps`` (2,) m and rad and halves them ``halvings`` times. ``normals`` (N, S, 3) are standard normal
    draws, scaled by ``spread`` (2,) m and rad round the optimum. Returns the mean of the posterior round the optimum
    (N, 3) and the log-evidence (N,).
    """
    n, samples = normals.shape[0], normals.shape[1]
    means = np.empty((n, 3))
    evidence = np.empty(n)
    logs = np.empty(samples + 1)
    sampled = np.empty((samples + 1, 3))
    for p in range(n):
        table, guess = tables[p], guesses[p]
        start = best_start(table, field, origin, cell, points, temper, guess, prior, starts, apart)
        x, y, heading = start[0], start[1], start[2]
        best = _log_posterior(table, field, origin, cell, points, temper, guess, prior, x, y, heading)
        step, turn = steps[0], steps[1]
        for _ in range(halvings + 1):
            move, failed, undone = 0, 0, -1
            for _ in range(moves):
                if move == undone:
                    value = -math.inf  # where it came from
                else:
                    sign = 1.0 if move % 2 == 0 else -1.0
                    nx = x + sign * step if move < 2 else x
                    ny = y + sign * step if 2 <= move < 4 else y
                    nh = heading + sign * turn if move >= 4 else heading
                    value = _log_posterior(table, field, origin, cell, points, temper, guess, prior, nx, ny, nh)
                if value > best:
                    best, x, y, heading = value, nx, ny, nh
                    failed, undone = 0, move ^ 1
                else:
                    failed += 1
                    if failed == 6:
                        break
                move = (move + 1) % 6
            step, turn = 0.5 * step, 0.5 * turn
        sampled[samples, 0], sampled[samples, 1], sampled[samples, 2] = x, y, heading
        logs[samples] = best
        top = best
        for k in range(samples):
            sampled[k, 0] = x + spread[0] * normals[p, k, 0]
            sampled[k, 1] = y + spread[0] * normals[p, k, 1]
            sampled[k, 2] = heading + spread[1] * normals[p, k, 2]
            logs[k] = _log_posterior(
                table, field, origin, cell, points, temper, guess, prior, sampled[k, 0], sampled[k, 1], sampled[k, 2]
            )
            top = max(top, logs[k])
        total = mx = my = mh = 0.0
        for k in range(samples + 1):
            w = math.exp(logs[k] - top)
            logs[k] = w
            total += w
            mx += w * sampled[k, 0]
            my += w * sampled[k, 1]
            mh += w * sampled[k, 2]
        mx, my, mh = mx / total, my / total, mh / total
        means[p, 0], means[p, 1], means[p, 2] = mx, my, mh
        evidence[p] = top + math.log(total / (samples + 1))
    return means, evidence


@kernel("f8[:, ::1], f8[::1], f8, f8, i8")
def spread_points(points: Floats, lidar_position: Floats, longest: float, spacing: float, most: int) -> Floats:
    """End points (k, 2) to match, of a scan's (m, 2): within ``longest`` m, ``spacing`` m apart along the wall.

    Where more than ``most`` remain, they are thinned evenly. Without this, near walls, which many beams hit, would
    outvote the far ones, which know the heading best.
    """
    kept = np.empty(len(points), np.int64)
    count = 0
    for b in range(len(points)):
        if math.hypot(points[b, 0] - lidar_position[0], points[b, 1] - lidar_position[1]) > longest:
            continue
        if count > 0:
            last = kept[count - 1]
            if math.hypot(points[b, 0] - points[last, 0], points[b, 1] - points[last, 1]) < spacing:
                continue
        kept[count] = b
        count += 1
    used = min(count, most)
    out = np.empty((used, 2))
    for k in range(used):
        b = kept[k * count // used]
        out[k, 0], out[k, 1] = points[b, 0], points[b, 1]
    return out
