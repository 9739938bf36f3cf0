"""Scans of differing beams brought to one grid of angles."""

import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.carmen_layouts import Scans

Array = NDArray[np.float64]

# How far, in beams, a scan's first angle may lie off the grid of beam angles: logs round angles to 1e-6 rad.
_OFF_GRID = 0.02
_TURN = 2 * math.pi
# Two neighbouring beams are taken to have hit one surface if their ranges differ by no more than this share.
_ONE_SURFACE = 0.1


def has_usable_beams(scans: Scans) -> NDArray[np.bool_]:
    """Which scans (n,) have beams that go round at most once, from within one turn of straight ahead."""
    turn = 2 * math.pi + 0.1
    with np.errstate(invalid="ignore"):
        span = scans.resolution * (scans.beams - 1)
        usable: NDArray[np.bool_] = (np.abs(scans.start) < turn) & (scans.resolution > 1e-4) & (span < turn)
    return usable


def on_one_grid(scans: Scans, notes: list[str]) -> tuple[Array, NDArray[np.float32], NDArray[np.bool_]]:
    """One grid of beam angles (B,), the ranges on it (k, B), and which scans (n,) bool fit it.

    Scans may differ in their number of beams or, interlaced, in their first angle: the grid then has all beams of all
    scans, and a scan has no return (range 0) where it has no beam. A scan that does not fit the grid is left out.
    """
    shapes = list(zip(scans.start.tolist(), scans.resolution.tolist(), scans.beams.tolist(), strict=True))
    (start, resolution, usual), _ = Counter(shapes).most_common(1)[0]
    finer = _finer_grid((scans.start - start) / resolution)
    step = resolution / finer
    offset = (scans.start - start) / step
    first = np.rint(offset).astype(int)
    fits = (np.abs(offset - first) < _OFF_GRID) & (np.abs(scans.resolution / resolution - 1) * scans.beams < 0.5)
    if not fits.all():
        notes.append(f"lidar: {int((~fits).sum())} scans with other beam angles than most left out")
    first, beams, rows = first[fits], scans.beams[fits], np.flatnonzero(fits)
    low = int(first.min())
    high = int((first + finer * (beams - 1)).max())
    ranges = np.zeros((len(rows), high - low + 1), dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        for (at, count), group in _groups(first, beams):
            ranges[group, at - low : at - low + finer * count : finer] = [scans.ranges[k] for k in rows[group]]
    if (beams != usual).any():
        counts = " or ".join(str(n) for n in np.unique(beams))
        notes.append(f"lidar: scans have {counts} beams; where a scan has no beam it has no return")
    if finer > 1:
        notes.append(f"lidar: scans are interlaced at 1/{finer} of a beam; each fills every {finer}th of all beams")
    return start + step * np.arange(low, high + 1), ranges, fits


def _finer_grid(offsets: Array) -> int:
    """Into how many parts a beam's width must be divided so that all first angles, in beams, fall on the grid."""
    for parts in (1, 2, 3, 4):
        off = np.abs(parts * offsets - np.rint(parts * offsets))
        if (off < _OFF_GRID).mean() > 0.9:
            return parts
    return 1


def _groups(first: NDArray[np.intp], beams: NDArray[np.intp]) -> list[tuple[tuple[int, int], NDArray[np.intp]]]:
    pairs, which = np.unique(np.stack([first, beams], axis=1), axis=0, return_inverse=True)
    return [((int(a), int(b)), np.flatnonzero(which.reshape(-1) == k)) for k, (a, b) in enumerate(pairs)]


