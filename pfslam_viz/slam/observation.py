"""The observation model: a scan's end points, and how well they agree with the map."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.config import ObservationConfig
from pfslam_viz.recordings.recording import Lidar
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import Scan
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ScanReader:
    """Turns ranges into a :class:`Scan`: equation (22), with the lidar's place on the robot.

    ``directions`` (B, 2) are unit vectors of the beams in the robot's frame.
    """

    directions: Array
    origin: Array
    shortest: float
    longest: float
    max_beams: int | None

    @classmethod
    def of(cls, lidar: Lidar, config: ObservationConfig) -> "ScanReader":
        """For one lidar under one configuration."""
        angles = lidar.angles + lidar.pose[2]
        longest = lidar.range_max if config.max_range is None else min(lidar.range_max, config.max_range)
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return cls(directions, lidar.pose[:2].copy(), lidar.range_min, longest, config.max_beams)

    def read(self, index: int, stamp: float, ranges: NDArray[np.float32]) -> Scan:
        """One scan's ranges (B,) m; those outside the limits are no return and are left out."""
        from pfslam_viz.slam import kernels

        points = kernels.read_scan(
            np.ascontiguousarray(ranges, np.float32), self.directions, self.origin, self.shortest, self.longest
        )
        if self.max_beams is not None and len(points) > self.max_beams:
            points = points[np.linspace(0, len(points) - 1, self.max_beams).round().astype(np.intp)]
        return Scan(index, stamp, points, self.origin)


def correlation(
    grid: OccupancyGrid, particles: Array, points: Array, config: ObservationConfig, worker: Worker | None = None
) -> Array:
    """(26) for every particle (N,); with ``perturbation``, the best over the offsets of section IV-E-1.

    The particles themselves stay where they are: an offset only finds the agreement in their neighbourhood.
    """
    if not config.perturbation:
        return grid.correlation(particles, points, worker).astype(np.float64)
    cells, angle = config.perturbation_cells, config.perturbation_angle
    best = np.zeros(len(particles))
    for turn in (-angle, 0.0, angle):
        for dx in range(-cells, cells + 1):
            for dy in range(-cells, cells + 1):
                offset = np.array([dx * grid.cell, dy * grid.cell, turn])
                np.maximum(best, grid.correlation(particles + offset, points, worker), out=best)
    return best
