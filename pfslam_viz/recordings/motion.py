"""Odometry from scan to scan: from the arrays that are given, as speeds, and as what it does to points."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import checks

Array = NDArray[np.float64]


def twists(odometry: Array, stamps: Array) -> Array:
    """Speeds (n + 1, 3) in m/s, m/s, rad/s in the robot's frame, up to each scan from the one before and one more.

    They are those of the increments (n, 3) between ``stamps`` (n,), steady between two scans. Before the first scan
    and after the last, the robot moves as next to it.
    """
    speeds = np.zeros((len(stamps) + 1, 3))
    if len(stamps) > 1:
        speeds[1:-1] = geometry.twist(odometry[1:]) / np.diff(stamps)[:, None]
        speeds[0], speeds[-1] = speeds[1], speeds[-2]
    return speeds


def moved(points: Array, times: Array, speeds: Array) -> Array:
    """Points (m, 2), each in the robot's frame at its own of the ``times`` (m,) s, in the frame at time 0.

    ``speeds`` (2, 3) are the robot's (m/s, m/s, rad/s) before and after it, each steady.
    """
    return displaced(points, times[:, None] * speeds[(times > 0).astype(np.intp)])


def displaced(points: Array, motions: Array) -> Array:
    """Points (m, 2), each in a frame of its own, in the frame from which the ``motions`` (m, 3) lead to those.

    Motions are as :func:`pfslam_viz.geometry.twist` gives them.
    """
    poses = geometry.steady_motion(motions)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = points.T
    return np.stack([poses[:, 0] + c * x - s * y, poses[:, 1] + s * x + c * y], axis=-1)


def steps_of(
    name: str, scans: int, odometry: ArrayLike | None, odometry_poses: ArrayLike | None, notes: list[str]
) -> Array:
    """Motion (n, 3) from scan to scan, from whichever kind of odometry is given; ``notes`` say where none is.

    Raises InputError for other shapes, or where both are given.
    """
    if odometry is not None and odometry_poses is not None:
        raise InputError(f"{name}: odometry and odometry_poses are both given; one of them is expected")
    if odometry_poses is not None:
        return geometry.increments(poses_of(odometry_poses, f"{name}: odometry_poses", scans))
    if odometry is not None:
        steps = poses_of(odometry, f"{name}: odometry", scans).copy()
        steps[:1] = 0.0
        return steps
    notes.append("odometry: none is given; the robot is taken to rest, and the filter has the scans alone")
    return np.zeros((scans, 3))


def poses_of(value: ArrayLike, what: str, scans: int) -> Array:
    """Poses (``scans``, 3) as they were given. Raises InputError for another shape."""
    return checks.poses(value, what, scans, ", a row for every scan")
