"""Scans of differing beams brought to one grid of angles."""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# How far, in beams, a scan's first angle may lie off the grid of beam angles: logs round angles to 1e-6 rad.
_OFF_GRID = 0.02
# How much farther than half a beam (in beams) still counts as half a beam.
_EVEN = 1e-6
_TURN = 2 * math.pi
# Two neighbouring beams are taken to have hit one surface if their ranges differ by no more than this share.
_ONE_SURFACE = 0.1


def has_usable_beams(start: Array, resolution: Array, beams: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which scans (n,) have beams that go round at most once, from within one turn of straight ahead."""
    turn = _TURN + 0.1
    with np.errstate(invalid="ignore"):
        span = resolution * (beams - 1)
        usable: NDArray[np.bool_] = (np.abs(start) < turn) & (resolution > 1e-4) & (span < turn)
    return usable


def on_one_grid(
    starts: Array, resolutions: Array, scans: Sequence[NDArray[np.floating]], notes: list[str]
) -> tuple[Array, NDArray[np.float32]]:
    """One grid of beam angles (B,) in rad and the ranges of all n scans on it (n, B).

    Each of the ``scans`` has ranges (beams,) of beams from its first angle ``starts`` (n,) on, ``resolutions`` (n,)
    apart, both in rad and usable (:func:`has_usable_beams`).

    Scans may differ in their number of beams or, interlaced, in their first angle: the grid then has all beams of all
    scans, and a scan has no return (range 0) where it has no beam. A scan that does not fit that grid is resampled
    (:func:`resample`). Where most do not fit, as with lidars that turn a little faster or slower each time, all are
    resampled to a grid of their median resolution.
    """
    beams = np.array([len(ranges) for ranges in scans], dtype=np.intp)
    shapes = list(zip(starts.tolist(), resolutions.tolist(), beams.tolist(), strict=True))
    (start, resolution, usual), _ = Counter(shapes).most_common(1)[0]
    finer = _finer_grid((starts - start) / resolution)
    step = resolution / finer
    offset = (starts - start) / step
    first = np.rint(offset).astype(int)
    last = first + finer * (beams - 1)
    fits = (np.abs(offset - first) < _OFF_GRID) & (np.abs(resolutions / resolution - 1) * beams < 0.5)
    low, high = int(first[fits].min()), int(last[fits].max())
    if fits.mean() < 0.5 or (high - low) * step > _TURN + step:
        angles = _common_grid(starts, resolutions, beams)
        fits, first = np.zeros(len(fits), dtype=np.bool_), first * 0
        notes.append(_resampled_note(beams, len(angles)))
    else:
        angles = start + step * np.arange(low, high + 1)
        if not fits.all():
            notes.append(f"lidar: {int((~fits).sum())} scans with other beam angles than most are brought to those")
        if finer > 1:
            notes.append(f"lidar: scans are interlaced at 1/{finer} of a beam; each fills every {finer}th of all beams")
        if (beams[fits] != usual).any():
            counts = " or ".join(str(n) for n in np.unique(beams[fits]))
            notes.append(f"lidar: scans have {counts} beams; where a scan has no beam it has no return")
    ranges = np.zeros((len(fits), len(angles)), dtype=np.float32)
    rows = np.flatnonzero(fits)
    with np.errstate(over="ignore", invalid="ignore"):
        for (at, count), group in _groups(first[fits], beams[fits]):
            ranges[rows[group], at - low : at - low + finer * count : finer] = [scans[k] for k in rows[group].tolist()]
        for k in np.flatnonzero(~fits).tolist():
            ranges[k] = resample(scans[k], float(starts[k]), float(resolutions[k]), angles)
    return angles, ranges


def resample(ranges: NDArray[np.floating], start: float, resolution: float, angles: Array) -> Array:
    """The ranges (B,) of a scan at evenly spaced ``angles`` (B,) rad; 0 where it has no beam nearby.

    Between two beams that hit one surface (their ranges differ by a tenth at most) the range is linear; else it is that
    of the nearer beam. A scan much coarser than the grid fills only the angle nearest to each of its beams.
    """
    step = float(angles[1] - angles[0]) if len(angles) > 1 else resolution
    if resolution > 1.5 * step:
        at = np.rint((start - angles[0] + resolution * np.arange(len(ranges))) / step).astype(int)
        at %= max(round(_TURN / step), len(angles))
        spread = np.zeros(len(angles))
        inside = at < len(angles)
        spread[at[inside]] = ranges[inside]
        return spread
    turn = _TURN / resolution
    if len(ranges) > turn - 0.75:  # all round: after the last beam comes the first
        ranges = np.append(ranges, ranges[0])
    position = np.mod((angles - start) / resolution, turn)
    just_before = (position > turn - 0.5 - _EVEN) & (position > len(ranges) - 0.5)
    position = np.where(just_before, position - turn, position)
    nearest = np.clip(np.rint(position), 0, len(ranges) - 1).astype(int)
    near = np.abs(position - nearest) <= 0.5 + _EVEN
    before = np.clip(np.floor(position), 0, max(len(ranges) - 2, 0)).astype(int)
    here, after = ranges[before], ranges[np.minimum(before + 1, len(ranges) - 1)]
    one_surface = np.abs(after - here) <= _ONE_SURFACE * np.minimum(here, after)
    share = np.clip(position - before, 0.0, 1.0)
    return np.where(near, np.where(one_surface, here + share * (after - here), ranges[nearest]), 0.0)


def _common_grid(starts: Array, resolutions: Array, beams: NDArray[np.intp]) -> Array:
    """Angles (B,) in rad at the scans' median resolution over what nine in ten of them see; a whole turn evenly."""
    step = float(np.median(resolutions))
    low = float(np.quantile(starts, 0.05))
    high = float(np.quantile(starts + resolutions * (beams - 1), 0.95))
    if float(np.median(resolutions * beams)) > _TURN - step:
        count = round(_TURN / step)
        step = _TURN / count
    else:
        count = int((high - low) / step + 1e-3) + 1
    return low + step * np.arange(count, dtype=np.float64)


def _resampled_note(beams: NDArray[np.intp], count: int) -> str:
    counts = f"{beams.min()} to {beams.max()}" if np.ptp(beams) else f"{beams[0]}"
    return f"lidar: scans of {counts} beams, at other angles each time; all brought to {count} common angles"


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
