"""Single steps of odometry that no robot makes: jumps, resets, wraps. They are not believed."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.checking.agreement import Pairs, disagreement
from pfslam_viz.recordings.checking.draft import Draft
from pfslam_viz.recordings.checking.odometry import FASTEST, FASTEST_TURN, speeds
from pfslam_viz.recordings.recording import Recording

Array = NDArray[np.float64]

# Stamps and odometry are rough: so much (m and rad) is added to what a robot can do between two scans.
_SLACK = 0.3
# A step is looked at if it is so many times as fast as 95 % of the steps are, and so much (m and rad) longer.
_TIMES, _LONGER = 6.0, 0.5
_MOST = 200  # steps that are looked at
# More steps than so many, and than this share, cannot be mended.
_FEW, _SHARE = 5, 0.02


def check_jumps(draft: Draft) -> None:
    """Impossible steps get the speed of the steps beside them, and are marked as not known; many are refused."""
    recording = draft.recording
    if len(recording) < 5:
        return
    intervals = draft.intervals()
    speed, turning = speeds(draft)
    step, turn = speed * intervals, turning * intervals
    impossible = (step > FASTEST * intervals + _SLACK) | (turn > FASTEST_TURN * intervals + _SLACK)
    usual, usual_turn = np.percentile(speed, 95), np.percentile(turning, 95)
    longer = (step > _TIMES * usual * intervals + _LONGER) | (turn > _TIMES * usual_turn * intervals + _LONGER)
    odd = np.flatnonzero(longer & ~impossible)
    if 0 < len(odd) <= _MOST:
        doubted = impossible.copy()
        doubted[odd] = True
        smooth = _bridged(recording.odometry, intervals, doubted)
        refuted = _refuted(recording, smooth, odd + 1)
        impossible[odd[refuted]] = True
    count = int(impossible.sum())
    if count == 0:
        return
    first = int(np.argmax(impossible))
    if count > _FEW and count > _SHARE * len(impossible):
        _refuse(draft, impossible, speed, turning)
        return
    where = recording.dead_reckoning()
    reset = bool(np.hypot(*where[first + 1, :2]) < 0.3 and np.hypot(*where[first, :2]) > 0.5)
    known = np.ones(len(recording), bool) if recording.odometry_known is None else recording.odometry_known.copy()
    known[1:][impossible] = False
    draft.mend(odometry=_bridged(recording.odometry, intervals, impossible), odometry_known=known)
    seen = f"{step[first]:.2f} m and {np.degrees(turn[first]):.0f}° in {intervals[first]:.3g} s at scan {first + 1:,}"
    more = f", and {count - 1} more such steps" if count > 1 else ""
    how = "jumps back to where it started" if reset else "jumps"
    draft.add(
        "doubtful",
        "odometry_reset" if reset else "odometry_jump",
        f"odometry: {how}, {seen}{more}; not believed, the speed beside it is taken instead",
        "look whether the map is whole there",
        first + 1,
    )


def _refuse(draft: Draft, impossible: NDArray[np.bool_], speed: Array, turning: Array) -> None:
    fastest, spins = float(np.median(speed[impossible])), float(np.median(turning[impossible]))
    draft.add(
        "wrong",
        "odometry_impossible",
        f"odometry: {int(impossible.sum()):,} of {len(impossible):,} steps are impossible, such as {fastest:.4g} m/s or"
        f" {spins:.4g} rad/s",
        "give m, rad and s, and motions from scan to scan rather than poses",
        int(np.argmax(impossible)) + 1,
    )


def _bridged(odometry: Array, intervals: Array, unknown: NDArray[np.bool_]) -> Array:
    """The odometry (n, 3) with the ``unknown`` (n - 1,) steps at the speed between those of the known ones beside."""
    rates = odometry[1:] / intervals[:, None]
    at, known = np.flatnonzero(unknown), np.flatnonzero(~unknown)
    out = odometry.copy()
    if len(known):
        for column in range(3):
            out[at + 1, column] = np.interp(at, known, rates[known, column]) * intervals[at]
    return out


def _refuted(recording: Recording, smooth: Array, steps: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which of the ``steps`` the scans at their two ends speak against, and for the ``smooth`` ones instead."""
    pairs = Pairs(steps - 1, steps)
    given = disagreement(recording.lidar, recording.ranges, recording.odometry, pairs)
    other = disagreement(recording.lidar, recording.ranges, smooth, pairs)
    off = np.where(np.isfinite(given), given, 1.0)
    refuted: NDArray[np.bool_] = np.isfinite(other) & (off > 0.15) & (other < 0.3 * off)
    return refuted
