"""What the particle filter found out on the way, for the pose graph: the increments between its key poses.

The filter matches every key scan with the whole map so far, from the pose that its particles expect. Where a match of
two scans is refused (little in common, or too far from the guess), that is still known, and the graph must not fall
back on the odometry. But the filter's position also carries what the odometry told it where its scan could not: along
a corridor, its increments repeat the wheels' error. So a constraint is as firm as the scan's own walls make it,
direction by direction.
"""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import FilterConstraintsConfig

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def filter_constraints(
    scans: ScanStore, increments: Array, joints: Indices, config: FilterConstraintsConfig
) -> Constraints:
    """The filter's ``increments`` (k - 1, 3) between key scans at some ``joints`` (j,), as robust constraints."""
    measured = increments[joints]
    driven, turned_by = np.hypot(measured[:, 0], measured[:, 1]), np.abs(measured[:, 2])
    firmness = (config.least_distance + config.noise_distance * driven) ** -2.0
    known = np.array([walls_of(scans, int(k) + 1, config) for k in joints]).reshape(-1, 2, 2)
    information = np.zeros((len(joints), 3, 3))
    information[:, :2, :2] = firmness[:, None, None] * known
    information[:, 2, 2] = (config.least_angle + config.noise_angle * turned_by) ** -2.0
    told = np.flatnonzero(known.any(axis=(1, 2)))
    at = joints[told]
    return Constraints(at, at + 1, measured[told], information[told], np.ones(len(at), np.bool_))


def heading_spans(increments: Array, config: FilterConstraintsConfig) -> list[Constraints]:
    """How far the filter says that the robot turned over many key scans, as robust constraints.

    Two spans of a kind overlap everywhere, and each counts half.
    """
    poses = geometry.accumulate(np.vstack([np.zeros(3), increments]))
    parts = []
    for span in config.spans:
        start = np.arange(0, len(poses) - span, max(span // 2, 1))
        information = np.zeros((len(start), 3, 3))
        information[:, 2, 2] = 0.5 * config.span_angle**-2.0
        measured = geometry.between(poses[start], poses[start + span])
        parts.append(Constraints(start, start + span, measured, information, np.ones(len(start), np.bool_)))
    return parts


def walls_of(scans: ScanStore, key: int, config: FilterConstraintsConfig) -> Array:
    """How much a scan's walls say about its position (2, 2), in its own frame: 1 along the direction known best.

    The eigenvalues of the normals' scatter; a direction that has less than ``least_share`` of the other's gets nothing.
    Zero where the scan has hardly a wall.
    """
    normals = scans.normals[scans.first[key] : scans.first[key + 1]].astype(np.float64)
    normals = normals[normals.any(axis=1)]
    if len(normals) < config.fewest_walls:
        return np.zeros((2, 2))
    values, vectors = np.linalg.eigh(normals.T @ normals)
    share = values / values[1]
    share[share < config.least_share] = 0.0
    known: Array = (vectors * share) @ vectors.T
    return known
