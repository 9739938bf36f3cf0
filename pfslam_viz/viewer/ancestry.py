"""Which particles of the past still have descendants: read from ``Estimate.parents``, nothing is estimated."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.viewer import kernels

Array = NDArray[np.float64]

WINDOW = 200  # scans that are looked back
NODES = 40  # positions along a lineage that are drawn
TRACED = 100  # particles whose ancestors are drawn


class Ancestry:
    """Keeps the last scans' particles and who came from whom."""

    def __init__(self, window: int = WINDOW) -> None:
        self._window = window
        self._positions = np.zeros((window, 0, 2), np.float32)  # rings
        self._parents = np.zeros((window, 0), np.int32)
        self._newest, self._count = -1, 0
        self._founders = np.zeros(0, np.int64)

    def add(self, particles: Array, parents: NDArray[np.intp]) -> int:
        """Take the particles (N, 3) of a scan; the number of distinct founders that they descend from.

        Founders are the particles of the scan at which the count began; it begins anew once a single one is left, and
        where another number of particles, or parents that do not exist, begin another story.
        """
        n = len(particles)
        founders, survivors = self._founders, -1
        if len(founders) == n == len(parents):
            founders, survivors = kernels.descend(founders, parents)
        follows = survivors > 0
        if not follows:
            self._positions = np.zeros((self._window, n, 2), np.float32)
            self._parents = np.zeros((self._window, n), np.int32)
            self._newest, self._count = -1, 0
        self._newest, self._count = (self._newest + 1) % self._window, min(self._count + 1, self._window)
        self._positions[self._newest] = particles[:, :2]
        if follows:
            self._parents[self._newest] = parents
        self._founders = founders if survivors > 1 else np.arange(n)
        return survivors if follows else n

    def segments(self) -> NDArray[np.float32]:
        """Pieces (m, 2, 2) of the surviving lineages: from an ancestor's position to its descendant's."""
        n = self._parents.shape[1]
        traced = np.unique(np.linspace(0, n - 1, min(n, TRACED)).astype(np.int64)) if n else np.zeros(0, np.int64)
        stride = max(-(-self._count // NODES), 1)
        return kernels.trace(self._positions, self._parents, self._newest, self._count, traced, stride)
