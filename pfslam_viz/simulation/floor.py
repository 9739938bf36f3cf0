"""The simulated buildings' floors: a colour for every point of the plan."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel

CHECKER, SLABS, PLANKS, BLUE_CARPET, GREEN_CARPET = range(5)
PATTERNS = ("checker", "slabs", "planks", "blue carpet", "green carpet")
TILE = 0.5  # m, edge of the checker's tiles
SLAB = 0.8  # m, edge of the slabs


@kernel()
def _shade(i: int, j: int) -> float:
    """A number in [-1, 1) that looks random but belongs to the tile i, j."""
    h = (i * 73856093) ^ (j * 19349663)
    h = (h ^ (h >> 13)) * 1274126177
    return ((h & 0xFFFF) / 32768.0) - 1.0


@kernel()
def pattern_color(pattern: int, x: float, y: float) -> tuple[float, float, float]:
    """RGB in 0..255 of a floor pattern at x, y (m, the plan's frame)."""
    if pattern == 0:
        i, j = int(np.floor(x / 0.5)), int(np.floor(y / 0.5))
        s = 5.0 * _shade(i, j)
        if (i + j) % 2 == 0:
            return 176.0 + s, 94.0 + s, 72.0 + s
        return 222.0 + s, 208.0 + s, 186.0 + s
    if pattern == 1:
        i, j = int(np.floor(x / 0.8)), int(np.floor(y / 0.8))
        s = 9.0 * _shade(i, j)
        fx, fy = x - 0.8 * i, y - 0.8 * j
        if min(fx, fy) < 0.04:
            return 92.0, 96.0, 104.0
        return 158.0 + s, 166.0 + s, 176.0 + s
    if pattern == 2:
        j = int(np.floor(y / 0.18))
        i = int(np.floor((x + 0.47 * (j % 3)) / 1.4))
        s = 16.0 * _shade(i, j)
        return 168.0 + s, 122.0 + 0.9 * s, 78.0 + 0.7 * s
    i, j = int(np.floor(x / 0.6)), int(np.floor(y / 0.6))
    s = 8.0 if (i + j) % 2 == 0 else -8.0
    if pattern == 3:
        return 74.0 + s, 98.0 + s, 140.0 + s
    return 92.0 + s, 128.0 + s, 96.0 + s


@kernel("f8, f8, f8[:, ::1], i8[::1]")
def floor_color(
    x: float, y: float, zones: NDArray[np.float64], floors: NDArray[np.int64]
) -> tuple[float, float, float]:
    """RGB in 0..255 of the floor at x, y (m, the plan's frame); (0, 0, 0) outside every zone."""
    for k in range(len(zones)):
        if zones[k, 0] <= x <= zones[k, 2] and zones[k, 1] <= y <= zones[k, 3]:
            return pattern_color(floors[k], x, y)
    return 0.0, 0.0, 0.0
