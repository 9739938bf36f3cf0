"""What every back end holds of its particles, and how it tells of them."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam import kernels
from pfslam_viz.slam.protocol import Estimate, Kept, LoopClosure, Match, Revision, Scan

Array = NDArray[np.float64]


class Belief:
    """N weighted particles, all at the origin at first, and the generator that their noise is drawn from."""

    def __init__(self, count: int, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._particles = np.zeros((count, 3))
        self._weigh(np.full(count, 1.0 / count))
        self._parents = self._ancestors = np.arange(count)
        self._informative = True
        self._resampled = False
        self._match: Match | None = None

    @property
    def best(self) -> Array:
        """(3,) the most likely particle after the last update: the "mode" of section I. Not to be written to."""
        return self._best

    def _weigh(self, weights: Array) -> None:
        """The particles have these weights (N,), which sum to 1, until they are weighed again; resampled or not."""
        self._weighed = (self._particles, weights)
        self._best: Array = self._particles[int(np.argmax(weights))].copy()  # a view would keep all of them alive

    @property
    def settles(self) -> bool:
        """No: what :meth:`finish` may move is up to the back ends that do."""
        return False

    @property
    def closures(self) -> tuple[LoopClosure, ...]:
        """None: who keeps one map keeps no scans to close a loop with."""
        return ()

    @property
    def kept(self) -> Kept | None:
        """None: who keeps one map settles nothing in hindsight."""
        return None

    def prepare(self, scan: Scan) -> Scan:
        """The scan as it is: who matches it with a map has nothing to make of it before."""
        return scan

    def revise(self) -> Revision | None:
        """None: who keeps one map cannot take back what was written into it."""
        return None

    def estimate(self) -> Estimate:
        """The belief after the scan, from the particles as they were weighed (before resampling)."""
        return self._estimate()

    def _estimate(self, drift: Array | None = None) -> Estimate:
        """The same, with what all particles may have drifted by, a covariance (3, 3)."""
        particles, weights = self._weighed
        mean, covariance, n_eff = kernels.moments(particles, weights)
        covariance = covariance if drift is None else covariance + drift
        return Estimate(
            particles=particles,
            weights=weights,
            best=self.best,
            mean=mean,
            covariance=covariance,
            n_eff=n_eff,
            resampled=self._resampled,
            informative=self._informative,
            parents=self._parents,
            match=self._match,
        )
