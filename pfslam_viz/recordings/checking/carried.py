"""A robot that was carried, or driven with its recorder off, while nothing was recorded: said, and left as read."""

import numpy as np

from pfslam_viz.recordings.checking.agreement import Pairs, disagreement
from pfslam_viz.recordings.checking.draft import Draft

# A gap is so many times as long as the usual interval, and so many seconds at least.
_TIMES, _SECONDS = 5.0, 1.0
# Only where the odometry says that the robot has hardly moved (m, rad) must the scans before and after look alike.
_MOVED, _TURNED = 0.3, 0.2
# So far are they apart if they do not: some times what neighbouring scans are, more than hardly any of them is, and
# something in itself. One corridor looks much like another.
_USUAL, _RARE, _LEAST = 3.0, 1.5, 0.03
_MOST = 200  # neighbours that tell what is usual


def check_carried(draft: Draft) -> None:
    """Doubtful where the scan after a gap sees another place than the one before, and the odometry stood still."""
    recording = draft.recording
    if len(recording) < 10:
        return
    intervals, steps = draft.intervals(), recording.odometry[1:]
    gap = (intervals > _TIMES * np.median(intervals)) & (intervals >= _SECONDS)
    gap &= (np.hypot(steps[:, 0], steps[:, 1]) < _MOVED) & (np.abs(steps[:, 2]) < _TURNED)
    if not gap.any():
        return
    after = np.flatnonzero(gap) + 1
    others = np.flatnonzero(~gap) + 1
    others = others[np.unique(np.linspace(0, len(others) - 1, _MOST).astype(int))]
    off, usual = (
        disagreement(recording.lidar, recording.ranges, recording.odometry, Pairs(which - 1, which))
        for which in (after, others)
    )
    if not np.isfinite(usual).any():
        return
    limit = max(_LEAST, _USUAL * float(np.nanmedian(usual)), _RARE * float(np.nanpercentile(usual, 99)))
    elsewhere = after[np.nan_to_num(off) > limit]
    if len(elsewhere) == 0:
        return
    first = int(elsewhere[0])
    more = f", and after {len(elsewhere) - 1} more gaps" if len(elsewhere) > 1 else ""
    draft.add(
        "doubtful",
        "carried",
        f"lidar: after {intervals[first - 1]:.1f} s without a scan, scan {first:,} sees another place than the one"
        f" before{more}, and the odometry says that the robot stood still: it was carried, or the recorder was off",
        f"replay the parts by themselves: --stop {first} and --start {first}",
        first,
    )
