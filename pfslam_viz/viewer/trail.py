"""A growing trajectory in three entities, so that a file stays small and a seek fast.

With m the cube root of the number of scans: ``done`` holds the whole trajectory every m² scans; ``between``, every m
scans, the stretch since then; ``open``, at every scan, the stretch since that. Together they are exactly the points up
to a scan, those where they meet twice. Of n scans that is n^(4/3) points in all.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float32]


Strips = list[tuple[int, Points]]  # a row, and the strip that is shown from there on


class Trail:
    """The trajectory of one thing over ``scans`` scans; with ``width`` 3, each of its points carries a number too."""

    def __init__(self, scans: int, width: int = 2) -> None:
        self._points = np.empty((scans, width), np.float32)
        self._count = self._done = self._between = 0
        self.every = max(round(np.cbrt(scans)), 2)

    def extend(
        self, poses: NDArray[np.float64], revised: Sequence[Points | None] | None = None
    ) -> tuple[Strips, Strips, list[Points]]:
        """Append poses (n, 3), of which x and y count, or n points of three numbers where these are kept.

        ``revised`` (n,) holds, where all that came before turned out to be different, the whole trajectory up to there
        (m, 2). Returns the ``done`` and the ``between`` strips with the row (index into ``poses``) each belongs to, and
        an ``open`` strip a row.
        """
        done, between, strips = [], [], []
        for row, pose in enumerate(poses):
            k = self._count
            self._count += 1
            self._points[k] = pose[: self._points.shape[1]]
            anew = None if revised is None else revised[row]
            if anew is not None:
                self._points[: k + 1] = anew
            if anew is not None or k % self.every**2 == 0:
                self._done = self._between = k
                done.append((row, self._points[: k + 1].copy()))
                between.append((row, self._points[k : k + 1].copy()))
            elif k % self.every == 0:
                self._between = k
                between.append((row, self._points[self._done : k + 1].copy()))
            strips.append(self._points[self._between : k + 1].copy())
        return done, between, strips


def level_pieces(points: Points) -> list[tuple[Points, int]]:
    """Points (m, 3) of x, y and a level as strips (k, 2) of one level each, which end where the next begins."""
    strips, lengths, levels, _ = level_strips([points])
    ends = np.cumsum(lengths)
    return [(strips[a:b], level) for a, b, level in zip(ends - lengths, ends, levels.tolist(), strict=True)]


def level_strips(
    trails: Sequence[Points],
) -> tuple[Points, NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """The same of many trails at once, (m, 3) each: all points (k, 2), the pieces one after the other.

    And how many each piece has, its level, and how many pieces each trail has.
    """
    sizes = np.array([len(trail) for trail in trails])
    points = np.concatenate([np.zeros((0, 3), np.float32), *trails])
    trail, levels = np.repeat(np.arange(len(trails)), sizes), points[:, 2].astype(np.intp)
    first = np.cumsum(sizes) - sizes
    legs = np.ones(len(points), np.bool_)  # whether one leads to a point from the one before
    legs[first[sizes > 0]] = False
    starts = legs.copy()  # of them the first of its piece
    starts[1:] &= ~(legs[:-1] & (levels[1:] == levels[:-1]))
    at = np.flatnonzero(starts)
    piece = np.cumsum(starts)[legs] - 1
    lengths = np.bincount(piece, minlength=len(at)) + 1
    ends = np.cumsum(lengths)
    chosen = np.repeat(at - 1 - (ends - lengths), lengths) + np.arange(lengths.sum())
    return points[chosen, :2], lengths, levels[at], np.bincount(trail[at], minlength=len(trails))
