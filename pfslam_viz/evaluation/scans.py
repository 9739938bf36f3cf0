"""Which scans an evaluation looks at, and their end points. Depends on the recording alone, never on an estimate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.motion import displaced, twists
from pfslam_viz.recordings.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EndPoints:
    """End points (m, 2) in m, with the index (m,) of the scan that each belongs to, ascending."""

    points: Array
    scan: NDArray[np.intp]

    def at(self, poses: Array) -> Array:
        """The points in the world (m, 2), if the scans were taken from ``poses`` (n, 3)."""
        p = poses[self.scan]
        c, s = np.cos(p[:, 2]), np.sin(p[:, 2])
        x, y = self.points.T
        return np.stack([p[:, 0] + c * x - s * y, p[:, 1] + s * x + c * y], axis=-1)


def key_scans(recording: Recording, distance: float = 0.25, angle: float = 0.35) -> NDArray[np.intp]:
    """Indices of scans that are ``distance`` m or ``angle`` rad of wheel odometry apart, the first one included.

    Spread over the way, not over time: a robot that stands still is not counted again and again. Odometry decides, so
    that every estimate of a recording is judged by the same scans.
    """
    steps = recording.odometry
    travelled = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) / distance + np.abs(steps[:, 2]) / angle)
    return np.flatnonzero(np.diff(np.floor(travelled), prepend=-1.0) > 0)


def end_points(recording: Recording, scans: NDArray[np.intp], most: int | None = None) -> EndPoints:
    """The end points of ``scans`` in the robot's frame, no-returns left out, evenly thinned to at most ``most``.

    Where beams have times, as seen from the pose at the scan's stamp, by odometry.
    """
    lidar = recording.lidar
    ranges = recording.ranges[scans].astype(np.float64)
    row, beam = np.nonzero((ranges >= lidar.range_min) & (ranges <= lidar.range_max))
    if most is not None and len(row) > most:
        kept = np.linspace(0, len(row) - 1, most).round().astype(np.intp)
        row, beam = row[kept], beam[kept]
    angles = lidar.angles[beam]
    returns = ranges[row, beam][:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points = geometry.transform(lidar.pose, returns)
    if recording.beam_times is not None:
        times = recording.beam_times[beam]
        speeds = twists(recording.odometry, recording.stamps)[scans[row] + (times > 0)]
        points = displaced(points, times[:, None] * speeds)
    return EndPoints(points, scans[row])
