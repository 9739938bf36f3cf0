"""The paper's filter: N poses, one map."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam import resampling
from pfslam_viz.slam.belief import Belief
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.paper import motion
from pfslam_viz.slam.paper.observation import OBSERVATION_MODELS
from pfslam_viz.slam.paper.settings import PaperConfig
from pfslam_viz.slam.protocol import Scan
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]


class ParticleFilter(Belief):
    """Algorithm 1: particles (N, 3) that share one occupancy grid, which the most likely of them writes.

    Everything starts at the origin; the first scan, which has no map to be compared with, is written into an empty one.
    """

    def __init__(self, config: PaperConfig, worker: Worker | None = None) -> None:
        """With a ``worker``, a second thread helps to weigh the particles; the results are the same."""
        super().__init__(config.particles, config.seed)
        self.config = config
        self.grid = OccupancyGrid(config.map)
        self._worker = worker
        self._weights = self._weighed[1]
        self._online: list[Array] = []

    def predict(self, increment: Array, dt: float, known: bool = True) -> None:
        """Move every particle by the odometry, with noise of its own: (13), (17) to (19); known or not."""
        self._particles = motion.predict(self._particles, increment, dt, self.config.motion, self._rng)

    def update(self, scan: Scan) -> None:
        """Multiply every weight by the correlation of the scan with the map: (26), (27)."""
        observation = self.config.observation
        model = OBSERVATION_MODELS[observation.model]
        likelihood = model(self.grid, self._particles, scan.points, observation, self._worker)
        posterior = self._weights * likelihood
        total = posterior.sum()
        self._informative = bool(total > 0)
        if self._informative:
            self._weights = posterior / total
        self._weigh(self._weights)
        self._parents = self._ancestors
        self._online.append(self.best)

    def update_map(self, scan: Scan) -> None:
        """The most likely particle writes the scan into the map: (28), (29)."""
        self.grid.add(self.best, scan.points, scan.lidar_position)

    def resample(self) -> None:
        """Resample N particles if the policy says so: (30) to (32)."""
        n = len(self._weights)
        self._resampled = resampling.is_due(self._weights, self.config.resampling)
        self._ancestors = np.arange(n)
        if self._resampled:
            self._ancestors = resampling.SCHEMES[self.config.resampling.scheme](self._weights, self._rng)
            self._particles = self._particles[self._ancestors]
            self._weights = np.full(n, 1.0 / n)

    def trajectory(self) -> Array:
        """(n, 3) the best particle at every scan: one map keeps no other history."""
        return np.array(self._online).reshape(-1, 3)

    def finish(self) -> None:
        """Nothing is settled in hindsight."""
