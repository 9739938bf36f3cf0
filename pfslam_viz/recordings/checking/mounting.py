"""A lidar that looks another way than is said: mirrored, wider, or backwards. Doubted, where the scans speak for it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.checking.agreement import disagreement, explains_better, pairs_apart, turned_apart
from pfslam_viz.recordings.checking.draft import Draft

Array = NDArray[np.float64]

_GOOD = 0.05  # disagreement of scans that needs no other reading
# Fields of view that are taken for one another: 180, 240, 270 and 360 degrees, and half the increment or twice.
_WIDER = (0.5, 2 / 3, 0.75, 4 / 3, 1.5, 2.0)


def check_mounting(draft: Draft) -> None:
    """Whether the scans turn the other way or more than the odometry does, or go back where it goes ahead."""
    recording = draft.recording
    lidar, ranges, odometry = recording.lidar, recording.ranges, recording.odometry
    if len(recording) < 5 or len(lidar.angles) < 2:
        return
    poses = draft.poses
    if _turns_otherwise(draft, poses):
        return
    pairs = pairs_apart(odometry, turn=1e9)
    given = disagreement(lidar, ranges, odometry, pairs, poses)
    if not _in_doubt(given):
        return
    backwards = replace(lidar, angles=lidar.angles + np.pi)
    if explains_better(disagreement(backwards, ranges, odometry, pairs, poses), given):
        draft.add(
            "doubtful",
            "lidar_looks_backwards",
            "lidar: the scans move ahead where the odometry moves back",
            "look at the lidar's yaw on the robot, or at the wheels' direction",
        )


def _in_doubt(given: Array) -> bool:
    """Whether the scans fit each other so badly that another reading may be right."""
    known = given[np.isfinite(given)]
    return len(known) >= 5 and float(np.median(known)) > _GOOD


def _turns_otherwise(draft: Draft, poses: Array) -> bool:
    """Whether the scans turn the other way, or more or less than the odometry; a finding then says so."""
    recording = draft.recording
    lidar, ranges, odometry = recording.lidar, recording.ranges, recording.odometry
    pairs = turned_apart(odometry)
    given = disagreement(lidar, ranges, odometry, pairs, poses)
    if not _in_doubt(given):
        return False
    mirrored = replace(lidar, angles=2 * lidar.angles.mean() - lidar.angles)
    if explains_better(disagreement(mirrored, ranges, odometry, pairs, poses), given):
        draft.add(
            "doubtful",
            "turns_reversed",
            "lidar: the scans turn the other way than the odometry does",
            "look at the order of the beams (counter-clockwise is positive), a lidar upside down, the gyro's sign",
        )
        return True
    for times in _WIDER:
        wider = replace(lidar, angles=lidar.angles.mean() + times * (lidar.angles - lidar.angles.mean()))
        if np.ptp(wider.angles) < 6.4 and explains_better(disagreement(wider, ranges, odometry, pairs, poses), given):
            seen, fits = np.degrees(np.ptp(lidar.angles)), np.degrees(np.ptp(wider.angles))
            draft.add(
                "doubtful",
                "field_of_view",
                f"lidar: the scans turn as if the beams spanned {fits:.0f}° rather than {seen:.0f}°",
                "say the lidar's field of view or its angle increment",
            )
            return True
    return False
