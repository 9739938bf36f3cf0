"""Odometry that the scans contradict, whatever the reason: doubted, since nothing can be told but that."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.checking.agreement import Pairs, disagreement, pairs_apart
from pfslam_viz.recordings.checking.draft import Draft

Array = NDArray[np.float64]

# Median disagreement of scans half a metre apart. Real logs in clutter come to 0.12, chance to 0.4.
_CONTRADICTED = 0.28
_NEAR = 1.0  # m; scans farther apart may well differ
_TURNS = np.array([0.15, 0.3, 0.5, 0.8, -0.15, -0.3, -0.5, -0.8])  # rad, between two scans


def check_contradiction(draft: Draft) -> None:
    """Whether scans do not fit each other where the odometry puts them, or turn where it never does."""
    recording = draft.recording
    if len(recording) < 5:
        return
    pairs = pairs_apart(recording.odometry)
    off = disagreement(recording.lidar, recording.ranges, recording.odometry, pairs, draft.poses)
    moved = geometry.between(draft.poses[pairs.first], draft.poses[pairs.second])
    near = (np.hypot(moved[:, 0], moved[:, 1]) < _NEAR) & np.isfinite(off)
    if near.sum() >= 10 and np.median(off[near]) > _CONTRADICTED:
        draft.add(
            "doubtful",
            "scans_contradict_odometry",
            "odometry: scans do not fit each other where it puts them",
            "look at its units and signs, at the beam angles, and whether both are of one drive",
        )
    elif len(pairs) >= 5 and np.abs(recording.odometry[:, 2]).max() < 1e-9 and _turns(draft, pairs):
        draft.add(
            "doubtful",
            "odometry_without_turns",
            "odometry: never turns, but the scans do",
            "look at the gyro, or at the odometry's headings",
        )


def _turns(draft: Draft, pairs: Pairs) -> bool:
    """Whether some scans fit the one before far better if the robot turned between them."""
    recording = draft.recording
    start = np.arange(0, len(recording) - 1, max(1, len(recording) // 300))
    gap = max(1, int(np.median(pairs.second - pairs.first)))
    all_pairs = Pairs(start, np.minimum(start + gap, len(recording) - 1))
    poses = draft.poses

    def fit(turn: float) -> Array:
        turned = poses.copy()
        turned[:, 2] += turn
        between = np.empty((2 * len(start), 3))
        between[::2], between[1::2] = poses[all_pairs.first], turned[all_pairs.second]
        rows = np.stack([all_pairs.first, all_pairs.second], axis=1).ravel()
        at = np.arange(len(start)) * 2
        return disagreement(recording.lidar, recording.ranges[rows], between, Pairs(at, at + 1), between)

    straight = fit(0.0)
    turning = np.nanmin(np.stack([straight, *(fit(turn) for turn in _TURNS)]), axis=0)
    told = np.isfinite(straight) & (straight > 0.15) & (turning < 0.5 * straight)
    return bool(told.sum() >= 3)
