"""Lidars whose every reading is written twice, as if there were twice as many beams."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.checking.draft import Draft

_FEWEST = 20  # beams, and readings, from which it can be told
_SCANS = 200  # that are looked at, throughout the recording
_SAME, _OTHERWISE = 0.99, 0.7  # shares of pairs that are alike: of the same reading at least, of two readings at most


def check_repeated(draft: Draft) -> None:
    """Of beams that repeat the one before them every other is left out: its angle is half a step wrong.

    A scan that is turned by so much makes the robot drive aslant through its map.
    """
    recording = draft.recording
    lidar, ranges = recording.lidar, recording.ranges
    beams = ranges.shape[1]
    if beams < _FEWEST:
        return
    some = ranges[:: max(1, len(ranges) // _SCANS)]
    # A pair of no returns is alike in any lidar; whatever stands for one is not known yet, but is the most frequent.
    values, counts = np.unique(some, return_counts=True)
    usual = values[np.argmax(counts)]
    if (
        _alike(some[:, :-1:2], some[:, 1::2], usual) < _SAME
        or _alike(some[:, 1:-1:2], some[:, 2::2], usual) > _OTHERWISE
    ):
        return
    times = recording.beam_times
    kept = replace(lidar, angles=lidar.angles[::2])
    draft.mend(
        lidar=kept, ranges=np.ascontiguousarray(ranges[:, ::2]), beam_times=None if times is None else times[::2]
    )
    message = (
        f"lidar: every reading is there twice; of {beams} beams {len(kept.angles)}, the first of each two, are used"
    )
    if beams % 2 == 1:
        draft.add("note", "beams_repeated", message)
        return
    step = abs(float(np.degrees(lidar.angles[1] - lidar.angles[0])))
    draft.add(
        "doubtful",
        "beams_repeated",
        message,
        f"if the second's angle is the right one, the lidar sits turned by {step:.3g} degrees; correct its yaw then",
    )


def _alike(one: NDArray[np.float32], other: NDArray[np.float32], usual: np.float32) -> float:
    """The share of pairs, (n, m) each, that are the same; those of the ``usual`` value, of no return, do not count."""
    looked = (one != usual) | (other != usual)
    if np.count_nonzero(looked) < _FEWEST:
        return 0.0
    return float((one == other)[looked].mean())
