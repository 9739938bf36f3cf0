"""Which particles of the past still have descendants: read from ``Estimate.parents``, nothing is estimated."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW = 200  # scans that are looked back
NODES = 40  # positions along a lineage that are drawn
TRACED = 100  # particles whose ancestors are drawn


class Ancestry:
    """Keeps the last scans' particles and who came from whom."""

    def __init__(self, window: int = WINDOW) -> None:
        self._positions: deque[NDArray[np.float32]] = deque(maxlen=window)
        self._parents: deque[NDArray[np.intp]] = deque(maxlen=window)
        self._founders: NDArray[np.intp] | None = None

    def add(self, particles: Array, parents: NDArray[np.intp]) -> int:
        """Take the particles (N, 3) of a scan; the number of distinct founders that they descend from.

        Founders are the particles of the scan at which the count began; it begins anew once a single one is left.
        """
        n = len(particles)
        fits = bool(self._positions) and len(parents) == n and int(parents.max(initial=0)) < len(self._positions[-1])
        if not fits:
            self._positions.clear()
            self._parents.clear()
            parents = np.arange(n)
        self._positions.append(particles[:, :2].astype(np.float32))
        self._parents.append(parents)
        if self._founders is None or not fits:
            self._founders = np.arange(n)
            return n
        self._founders = self._founders[parents]
        survivors = int(np.count_nonzero(np.bincount(self._founders)))
        if survivors == 1:
            self._founders = np.arange(n)
        return survivors

    def segments(self) -> NDArray[np.float32]:
        """Pieces (m, 2, 2) of the surviving lineages: from an ancestor's position to its descendant's."""
        count = len(self._positions)
        n = len(self._positions[-1]) if count else 0
        alive = np.unique(np.linspace(0, n - 1, min(n, TRACED)).astype(np.intp)) if n else np.zeros(0, np.intp)
        stride = max(-(-count // NODES), 1)
        pieces = []
        newer, position = count - 1, alive
        while newer - stride >= 0:
            ancestors = position
            for k in range(newer, newer - stride, -1):
                ancestors = self._parents[k][ancestors]
            older = newer - stride
            ends = np.stack([self._positions[older][ancestors], self._positions[newer][position]], axis=1)
            pieces.append(ends)
            newer, position = older, np.unique(ancestors)
        return np.concatenate(pieces) if pieces else np.zeros((0, 2, 2), np.float32)
