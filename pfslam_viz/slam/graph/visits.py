"""Where a trajectory comes back to: the key scans of earlier visits to the same place."""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@kernel("f8[:, ::1], f8, i8, i8, f8, i8")
def earlier_visits(poses: Array, radius: float, apart: int, most: int, turn_length: float, since: int = 0) -> Indices:
    """Pairs (p, 2): for every key scan up to ``most`` earlier ones within ``radius`` m, the nearest of each visit.

    Only key scans from ``since`` on are looked at. A rad between their headings counts as ``turn_length`` m. The plain
    twin is in the tests.
    """
    n = len(poses)
    found = np.empty(((n - since) * most, 2), np.int64)
    away, near = np.empty(n), np.empty(n, np.int64)
    count = 0
    for later in range(since, n):
        last, nearby = later - apart, 0
        for k in range(last):
            dx, dy = poses[k, 0] - poses[later, 0], poses[k, 1] - poses[later, 1]
            if dx * dx + dy * dy > radius * radius:
                continue
            turn = abs(poses[k, 2] - poses[later, 2]) % (2.0 * math.pi)
            away[nearby] = math.hypot(dx, dy) + turn_length * min(turn, 2.0 * math.pi - turn)
            near[nearby] = k
            nearby += 1
        for _ in range(most):
            best, nearest = np.inf, -1
            for at in range(nearby):
                if away[at] < best:
                    best, nearest = away[at], near[at]
            if nearest < 0:
                break
            found[count, 0], found[count, 1] = nearest, later
            count += 1
            for at in range(nearby):
                if abs(near[at] - nearest) <= apart // 2:
                    away[at] = np.inf
    pairs = np.empty((count, 2), np.int64)
    for k in range(count):
        pairs[k, 0], pairs[k, 1] = found[k, 0], found[k, 1]
    return pairs
