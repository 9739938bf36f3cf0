"""A lidar that looks another way than is said: mirrored, or backwards. Doubted, where the scans speak for it."""

from dataclasses import replace

import numpy as np

from pfslam_viz.recordings.checking.agreement import disagreement, explains_better, pairs_apart, turned_apart
from pfslam_viz.recordings.checking.draft import Draft


def check_mounting(draft: Draft) -> None:
    """Whether the scans turn the other way than the odometry does, or go back where it goes ahead."""
    recording = draft.recording
    lidar, ranges, odometry = recording.lidar, recording.ranges, recording.odometry
    if len(recording) < 5 or len(lidar.angles) < 2:
        return
    pairs = turned_apart(odometry)
    given = disagreement(lidar, ranges, odometry, pairs)
    mirrored = replace(lidar, angles=2 * lidar.angles.mean() - lidar.angles)
    if explains_better(disagreement(mirrored, ranges, odometry, pairs), given):
        draft.add(
            "doubtful",
            "turns_reversed",
            "lidar: the scans turn the other way than the odometry does",
            "look at the order of the beams (counter-clockwise is positive), a lidar upside down, the gyro's sign",
        )
        return
    pairs = pairs_apart(odometry, turn=1e9)
    given = disagreement(lidar, ranges, odometry, pairs)
    backwards = replace(lidar, angles=lidar.angles + np.pi)
    if explains_better(disagreement(backwards, ranges, odometry, pairs), given):
        draft.add(
            "doubtful",
            "lidar_looks_backwards",
            "lidar: the scans move ahead where the odometry moves back",
            "look at the lidar's yaw on the robot, or at the wheels' direction",
        )
