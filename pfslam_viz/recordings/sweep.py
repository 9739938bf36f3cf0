"""When each beam of a scan was measured, told from the recording where its format does not say.

A lidar that turns once a scan sees its beams from different poses while the robot turns: at 5 Hz and 2 rad/s the last
is 23 degrees off the first. Whether it does, which way round, and which beam the stamp belongs to shows in scans taken
while the robot turns: corrected rightly, they agree with one taken nearby while it does not.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.motion import moved, twists
from pfslam_viz.recordings.recording import Recording

Array = NDArray[np.float64]

# A lidar that sees less than this (rad) need not turn; scans are a turn apart at such periods (s).
_LEAST_VIEW = 3.5
_PERIODS = (0.01, 0.5)
# During a scan the robot turns by at least this (rad), and by less than the other while it is taken not to turn.
_TURNING, _CALM = 0.06, 0.02
_IMPOSSIBLE = 1.5
# A scan is compared with one at most so many scans and metres away; fewer pairs tell nothing, more only cost time.
_SCANS, _METERS = 12, 1.0
_FEWEST_PAIRS, _MOST_PAIRS = 6, 24
_BEAMS = 240
# Ranges that differ by more than this (m) are of different things; odometry may err by so many rad, at this price.
_DIFFERENT = 0.3
_HEADINGS = np.linspace(-0.4, 0.4, 41)
_FINER = np.linspace(-0.016, 0.016, 9)
_METERS_PER_RADIAN = 0.25
# Beams across a greater gap (rad) than this do not make a wall.
_GAP = 0.1
# The scans have to disagree by so much less, in so many of the pairs.
_LESS, _MOST = 0.7, 0.6

_ONE_MOMENT = "of one moment"
_STAMPED = {"first": 0.0, "middle": 0.5, "last": 1.0}


class Sweep(NamedTuple):
    """``beam_times`` (B,) s after the stamp, or None for a scan of one moment; and that in words.

    ``before`` and ``after`` are the mean disagreement (m) of scans taken in turns, as they were given and by these.
    """

    beam_times: Array | None
    before: float
    after: float
    words: str


def with_beam_times(recording: Recording) -> Recording:
    """The recording with its beams' times and a note on them, where they can be told; else the recording itself.

    Times that the format gave are kept unless the scans clearly contradict them.
    """
    if (found := find(recording)) is None:
        return recording
    instead = "" if recording.beam_times is None else ", other than the file says"
    note = (
        f"lidar: the beams of a scan are taken as {found.words}{instead}: scans taken in turns then agree to"
        f" {100 * found.after:.1f} instead of {100 * found.before:.1f} cm"
    )
    return replace(recording, beam_times=found.beam_times, notes=(*recording.notes, note))


def find(recording: Recording) -> Sweep | None:
    """The times of the beams that make scans agree clearly better than those they have; None if none do."""
    if (np.abs(recording.odometry[:, 2]) > _TURNING).sum() < _FEWEST_PAIRS // 2:
        return None
    angles = recording.lidar.angles
    if len(recording) < _FEWEST_PAIRS or len(angles) < 20 or np.ptp(angles) < _LEAST_VIEW:
        return None
    period = float(np.median(np.diff(recording.stamps)))
    if not _PERIODS[0] <= period <= _PERIODS[1]:
        return None
    speeds = twists(recording.odometry, recording.stamps)
    pairs = _pairs(recording, speeds[:, 2] * period)
    if len(pairs) < _FEWEST_PAIRS:
        return None
    forwards = period * (angles - angles[0]) / (2 * np.pi)
    length = float(forwards[-1])
    guesses: list[tuple[Array, str]] = [(np.zeros(len(angles)), _ONE_MOMENT)]
    if recording.beam_times is not None:
        guesses.insert(0, (recording.beam_times, "the file says"))
    for way, times in (("counter-clockwise", forwards), ("clockwise", length - forwards)):
        for which, share in _STAMPED.items():
            words = f"spread over {length:.3f} s, {way}, the stamp being that of the {which} one"
            guesses.append((times - share * length, words))
    disagreement = np.array([_disagreement(recording, speeds, pairs, times) for times, _ in guesses])
    means = disagreement.mean(axis=1)
    best = int(np.argmin(means))
    better = (disagreement[best] < disagreement[0]).mean()
    if best == 0 or means[best] > _LESS * means[0] or better < _MOST:
        return None
    times, words = guesses[best]
    return Sweep(None if words == _ONE_MOMENT else times, float(means[0]), float(means[best]), words)


def _pairs(recording: Recording, turns: Array) -> list[tuple[int, int]]:
    """Scans taken while the robot turned, each with one nearby from when it did not; ``turns`` (n + 1,) rad a scan."""
    most = np.maximum(np.abs(turns[:-1]), np.abs(turns[1:]))
    turning = np.flatnonzero((most > _TURNING) & (most < _IMPOSSIBLE))
    calm = most < _CALM
    places = recording.dead_reckoning()[:, :2]
    pairs: list[tuple[int, int]] = []
    for k in turning.tolist():
        near = np.arange(max(k - _SCANS, 0), min(k + _SCANS + 1, len(calm)))
        near = near[calm[near] & (np.hypot(*(places[near] - places[k]).T) < _METERS)]
        if len(near):
            pairs.append((k, int(near[np.argmin(np.abs(near - k))])))
    if len(pairs) > _MOST_PAIRS:
        pairs = [pairs[i] for i in np.linspace(0, len(pairs) - 1, _MOST_PAIRS).round().astype(np.intp)]
    return pairs


def _disagreement(recording: Recording, speeds: Array, pairs: list[tuple[int, int]], times: Array) -> Array:
    """How far (m) the scans of each pair (p,) differ, at the heading at which they differ least."""
    poses = recording.dead_reckoning()
    apart = []
    for k, j in pairs:
        reference = _seen(recording, speeds, j, times, geometry.between(poses[k], poses[j]))
        apart.append(_least_difference(_seen(recording, speeds, k, times), reference))
    return np.array(apart)


def _seen(recording: Recording, speeds: Array, k: int, times: Array, pose: Array | None = None) -> tuple[Array, Array]:
    """Bearings and ranges (m,) of a scan's end points from the lidar; ``pose`` is the scan's, in another's frame."""
    lidar = recording.lidar
    every = -(-len(lidar.angles) // _BEAMS)
    ranges, angles, times = recording.ranges[k, ::every].astype(np.float64), lidar.angles[::every], times[::every]
    good = (ranges >= lidar.range_min) & (ranges <= lidar.range_max)
    ranges, angles, times = ranges[good], angles[good], times[good]
    points = geometry.transform(lidar.pose, ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1))
    points = moved(points, times, speeds[k : k + 2])
    if pose is not None:
        points = geometry.transform(pose, points)
    x, y = (points - lidar.pose[:2]).T
    bearings = np.arctan2(y, x)
    order = np.argsort(bearings)
    return bearings[order], np.hypot(x, y)[order]


def _least_difference(scan: tuple[Array, Array], reference: tuple[Array, Array]) -> float:
    """The mean difference (m) of ranges at the same bearing, with a price for turning the scan."""
    bearings, ranges = scan
    at, there = reference
    if len(bearings) < 20 or len(at) < 20:
        return _DIFFERENT
    # A turn more on either side, and nothing in the middle of a gap.
    at, there = np.concatenate([at - 2 * np.pi, at, at + 2 * np.pi]), np.tile(there, 3)
    gap = np.flatnonzero(np.diff(at) > _GAP)
    at = np.insert(at, gap + 1, 0.5 * (at[gap] + at[gap + 1]))
    there = np.insert(there, gap + 1, np.nan)

    def least(turns: Array) -> tuple[float, float]:
        apart = np.minimum(np.abs(np.interp(bearings + turns[:, None], at, there) - ranges), _DIFFERENT)
        both = np.isfinite(apart)
        seen = both.sum(axis=1)
        mean = np.where(both, apart, 0.0).sum(axis=1) / np.maximum(seen, 1)
        costs = np.where(seen > 0.5 * len(ranges), mean, _DIFFERENT) + _METERS_PER_RADIAN * np.abs(turns)
        k = int(np.argmin(costs))
        return float(costs[k]), float(turns[k])

    _, coarse = least(_HEADINGS)
    return least(coarse + _FINER)[0]
