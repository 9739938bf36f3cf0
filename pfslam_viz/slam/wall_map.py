"""An occupancy grid whose occupied cells know where in them the wall is."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.config import MapConfig, MatchingConfig
from pfslam_viz.slam import point_to_line
from pfslam_viz.slam.occupancy_grid import OccupancyGrid

Array = NDArray[np.float64]


class WallMap(OccupancyGrid):
    """Log-odds say whether a cell is occupied; ``walls`` (rows, columns, 5) float32 what its end points have in common.

    Those are their number, their mean x and y (m, world) and their wall's mean normal, see
    :mod:`pfslam_viz.slam.point_to_line`.
    """

    _LAYERS = (*OccupancyGrid._LAYERS, "walls")

    def __init__(self, config: MapConfig, matching: MatchingConfig) -> None:
        super().__init__(config)
        self.matching = matching
        self.walls = np.zeros((*self.shape, 5), np.float32)

    def add_scan(self, pose: Array, points: Array, normals: Array, sensor: Array) -> None:
        """Write a scan seen from ``pose`` (3,), as :meth:`add` does, and average it into the walls.

        ``points`` (m, 2), their ``normals`` (m, 2) and ``sensor`` (2,) are in the robot's frame.
        """
        self.add(pose, points, sensor)
        point_to_line.add_walls(
            self.walls, self.occupied, *self.origin, self.cell, pose, points, normals, self.matching.memory
        )

    def match(
        self, guess: Array, prior: Array, points: Array, normals: Array, start: Array | None = None
    ) -> tuple[Array, Array, float, Array]:
        """The pose (3,) that agrees best with the scan and with ``guess`` (3,), whose information ``prior`` (3, 3) is.

        The climb begins at ``start`` (3,), or at the guess. Also returned: the information (3, 3) that the scan adds,
        the mean agreement of its end points in [0, 1], and for each of them the wall it was paired with (m, 5).
        """
        m = self.matching
        partners = np.zeros((len(points), 5))
        pose, information, score = point_to_line.match(
            self.walls, self.occupied, *self.origin, self.cell,
            guess, prior, guess if start is None else start, points, normals, m.search, m.sigma, m.temper, partners,
        )  # fmt: skip
        return pose, information, score, partners
