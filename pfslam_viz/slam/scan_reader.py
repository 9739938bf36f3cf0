"""From a scan's ranges to its end points: equation (22), and the robot's motion while the lidar went round."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.motion import moved
from pfslam_viz.recordings.recording import Lidar
from pfslam_viz.settings import ScanConfig
from pfslam_viz.slam import kernels
from pfslam_viz.slam.protocol import Scan

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ScanReader:
    """Turns ranges into a :class:`Scan`, with the lidar's position on the robot.

    ``directions`` (B, 2) are unit vectors of the beams in the robot's frame, ``lidar_position`` (2,) m the lidar there.
    A range from ``shortest`` to ``longest`` m is a return: the beam hit something and came back. ``beam_times`` (B,) s
    after the scan's stamp are those of the beams, or None where a scan is taken as of one moment.
    """

    directions: Array
    lidar_position: Array
    shortest: float
    longest: float
    max_beams: int | None
    beam_times: Array | None = None

    @classmethod
    def of(cls, lidar: Lidar, config: ScanConfig, beam_times: Array | None = None) -> "ScanReader":
        """For one lidar, with its recording's ``beam_times``, under one configuration."""
        angles = lidar.angles + lidar.pose[2]
        longest = lidar.range_max if config.max_range is None else min(lidar.range_max, config.max_range)
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return cls(
            directions,
            lidar.pose[:2].copy(),
            lidar.range_min,
            longest,
            config.max_beams,
            beam_times if config.deskew else None,
        )

    def read(self, index: int, stamp: float, ranges: NDArray[np.float32], twists: Array | None = None) -> Scan:
        """One scan's ranges (B,) m; those outside the limits are no return and are left out.

        With ``twists`` (2, 3), the robot's speeds (m/s, m/s, rad/s) before and after the stamp, end points are given as
        seen from the pose at the stamp, if the beams have times.
        """
        ranges = np.ascontiguousarray(ranges, np.float32)
        points = kernels.read_scan(ranges, self.directions, self.lidar_position, self.shortest, self.longest)
        if self.beam_times is not None and twists is not None and twists.any():
            exact = ranges.astype(np.float64)  # as the kernel compares them: the limits are not rounded to float32
            times = self.beam_times[(exact >= self.shortest) & (exact <= self.longest)]
            points = moved(points, times, twists)
        if self.max_beams is not None and len(points) > self.max_beams:
            points = points[np.linspace(0, len(points) - 1, self.max_beams).round().astype(np.intp)]
        return Scan(index, stamp, points, self.lidar_position)
