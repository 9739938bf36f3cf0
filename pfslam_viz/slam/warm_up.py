"""Every kernel of the paper's filter, called once."""

import numpy as np

from pfslam_viz.slam import kernels, map_kernels


def warm_up() -> None:
    """Compile every kernel of both modules, or load it from the cache of an earlier run."""
    grid, scratch = np.zeros((4, 4), np.float32), np.zeros((4, 4), np.uint8)
    occupied, points = np.zeros((4, 4), np.uint8), np.zeros((1, 2))
    pose = np.zeros((1, 3))
    kernels.move(pose, np.zeros(3), pose)
    kernels.compose(pose[0], pose[0])
    kernels.moments(pose, np.ones(1))
    kernels.pick(np.ones(1), np.zeros(1))
    kernels.correlate(pose, points, occupied, 2, 2, 1.0, occupied.copy(), np.zeros(1, np.int64), np.zeros(2, np.int64))
    kernels.project(np.zeros(3), points, occupied, 2, 2, 1.0)
    one = np.float32(1.0)
    map_kernels.add_scan(np.zeros(3), points, np.zeros(2), grid, occupied, scratch, 1, 2, 2, 1.0, one, one, one, one)
    first = np.array([0, 1])
    map_kernels.add_scans(
        pose, points, first, np.zeros((1, 2)), 0, grid, occupied, scratch, 2, 2, 2, 1.0, one, one, one, one
    )
    kernels.transform(pose[0], points)
    kernels.read_scan(np.ones(1, np.float32), points, np.zeros(2), 0.0, 2.0)
