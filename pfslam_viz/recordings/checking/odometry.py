"""Odometry that cannot be right: poses where increments are due, degrees, millimetres, jumps, or none at all."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.checking.agreement import Pairs, disagreement, explains_better, pairs_apart, turned_apart
from pfslam_viz.recordings.checking.draft import Draft
from pfslam_viz.recordings.checking.stretches import stretches, told
from pfslam_viz.recordings.recording import Recording

Array = NDArray[np.float64]

# What no robot with a scanner reaches, over a scan: m/s and rad/s.
FASTEST, FASTEST_TURN = 10.0, 20.0
LENGTHS = {1e-3: "millimetres", 1e-2: "centimetres"}
_KINDS = {
    "odometry_cumulative": "odometry: holds poses where motions from scan to scan are due ({speed:.3g} m/s, if they"
    " were motions); taken as poses (odometry_poses)",
    "odometry_in_millimetres": "odometry: in millimetres ({speed:.4g} m/s, if it were metres); converted to metres",
    "odometry_in_centimetres": "odometry: in centimetres ({speed:.4g} m/s, if it were metres); converted to metres",
}
_NOTHING = 1e-9  # m and rad
_MOVED = 0.1  # disagreement of scans, relative to their ranges, that noise and people do not make

_STRETCHES = 20  # of rest that are looked at, the longest


def check_odometry(draft: Draft) -> None:
    """All that can be told of the odometry, and what of it can be mended."""
    if len(draft.recording) < 5:
        return
    if np.abs(draft.recording.odometry).max() < _NOTHING:
        _check_absent(draft)
        return
    _check_kind(draft)
    _check_degrees(draft)
    _check_stuck(draft)


def speeds(draft: Draft, odometry: Array | None = None) -> tuple[Array, Array]:
    """Speed (n - 1,) m/s and yaw rate (n - 1,) rad/s, both without sign, from each scan to the next."""
    steps = (draft.recording.odometry if odometry is None else odometry)[1:]
    intervals = draft.intervals()
    return np.hypot(steps[:, 0], steps[:, 1]) / intervals, np.abs(steps[:, 2]) / intervals


def _fits(recording: Recording, odometry: Array, pairs: Pairs) -> Array:
    return disagreement(recording.lidar, recording.ranges, odometry, pairs)


def _check_kind(draft: Draft) -> None:
    """Poses that were given as if they were motions, and motions in mm or cm: by their speed and by the scans."""
    recording = draft.recording
    speed, turning = speeds(draft)
    if np.percentile(speed, 90) < 2.5 and np.percentile(turning, 90) < 2.0:
        return
    readings = {"odometry_as_given": recording.odometry, "odometry_cumulative": _as_poses(recording.odometry)}
    readings |= {f"odometry_in_{unit}": recording.odometry * (f, f, 1.0) for f, unit in LENGTHS.items()}
    for what, steps in list(readings.items())[1:]:
        fast, spins = speeds(draft, steps)
        if np.percentile(fast, 98) > FASTEST or np.percentile(spins, 98) > FASTEST_TURN:
            continue
        pairs = pairs_apart(steps, distance=0.8, turn=0.5)
        fit = _fits(recording, steps, pairs)
        # Small motions fit better than large ones, whatever they are: so it must also beat no motion.
        others = [0.0 * steps, *(other for name, other in readings.items() if name != what)]
        if all(explains_better(fit, _fits(recording, other, pairs)) for other in others):
            draft.mend(odometry=steps)
            draft.add("note", what, _KINDS[what].format(speed=float(np.percentile(speed, 90))))
            return


def _as_poses(odometry: Array) -> Array:
    """Motions between poses (n, 3), the first of which is lost."""
    steps = geometry.increments(odometry)
    if np.abs(steps[1]).max() > 3 * np.abs(steps[2:12]).max():
        steps[1] = steps[2]
    return steps


def _check_degrees(draft: Draft) -> None:
    """Turns in degrees, or a yaw rate in degrees a second."""
    recording = draft.recording
    _, turning = speeds(draft)
    if np.sort(turning)[-5:][0] < 2.0:
        return
    steps = _turned_less(recording.odometry)
    pairs = turned_apart(steps)
    fit = _fits(recording, steps, pairs)
    others = (recording.odometry, steps * (1.0, 1.0, 0.0))  # it must also beat no turns at all
    if not all(explains_better(fit, _fits(recording, other, pairs)) for other in others):
        return
    said = f"odometry: turns of up to {turning.max():.3g} rad/s are degrees by what the scans show"
    direction = np.arctan2(steps[:, 1], steps[:, 0])
    length = np.hypot(steps[:, 0], steps[:, 1])
    ahead = np.abs((length * np.exp(2j * direction)).sum()) / max(float(length.sum()), _NOTHING)
    if length.sum() > 1.0 and ahead < 0.7:
        draft.add("wrong", "turns_in_degrees", said, "give headings, turns and yaw rates in radians")
        return
    draft.mend(odometry=steps)
    draft.add("note", "turns_in_degrees", f"{said}; converted to radians")


def _turned_less(odometry: Array) -> Array:
    """The ``odometry`` (n, 3) with its turns taken as degrees.

    Where it was made of wheels and a gyro, equation (17), the step was bent by the turn; it is bent anew.
    """
    x, y, turn = odometry.T
    half, length = 0.5 * turn, np.hypot(x, y)
    ahead = x * np.cos(half) + y * np.sin(half)
    turned = (length > 1e-4) & (np.abs(turn) > 0.02)
    out = odometry.copy()
    out[:, 2] = np.radians(turn)
    if turned.sum() > 3 and np.median(1.0 - np.abs(ahead[turned]) / length[turned]) < 1e-4:
        bent = np.sinc(half / np.pi)
        rolled = np.where(np.abs(bent) > 0.05, ahead / np.where(bent == 0, 1.0, bent), np.nan)
        known = np.isfinite(rolled)
        rolled = np.interp(np.arange(len(rolled)), np.flatnonzero(known), rolled[known])
        straight = rolled * np.sinc(0.5 * out[:, 2] / np.pi)
        out[:, 0], out[:, 1] = straight * np.cos(0.5 * out[:, 2]), straight * np.sin(0.5 * out[:, 2])
    return out


def _check_absent(draft: Draft) -> None:
    """Odometry that is zero throughout, while the scans do or do not change."""
    recording = draft.recording
    moved = _moved(recording, np.linspace(0, len(recording) - 1, 24).astype(int))
    seen = "the scans show that the robot moves" if moved else "the scans do not change either"
    draft.add(
        "doubtful" if moved else "note",
        "no_odometry",
        f"odometry: there is none, or it is zero throughout; {seen}",
        "scans are matched with each other alone; add odometry if the robot has any" if moved else "",
    )
    if moved:
        draft.mend(odometry_known=np.zeros(len(recording), np.bool_))


def _moved(recording: Recording, scans: NDArray[np.intp]) -> bool:
    """Whether most of the ``scans`` are unlike the one before them here."""
    scans = np.unique(scans)
    pairs = Pairs(scans[:-1], scans[1:])
    off = _fits(recording, np.zeros_like(recording.odometry), pairs)
    return bool(np.median(np.where(np.isfinite(off), off, 1.0)) > _MOVED) if len(off) else False


def _check_stuck(draft: Draft) -> None:
    """Stretches in which the odometry stands still while the scans do not."""
    recording = draft.recording
    rests = np.abs(recording.odometry[:, :2]).max(axis=1) < _NOTHING
    rests[0] = False
    starts, ends = (k - 1 for k in stretches(rests))  # scans between which it rests
    lasted = recording.stamps[ends] - recording.stamps[starts]
    long = np.flatnonzero((lasted > 5.0) & (ends - starts >= 10))
    long = long[np.argsort(-lasted[long])][:_STRETCHES]
    if len(long) == 0:
        return
    starts, ends, lasted = starts[long], ends[long], lasted[long]
    quarters = starts + (ends - starts) * np.arange(5)[:, None] // 4
    pairs = Pairs(quarters[:-1].ravel(), quarters[1:].ravel())
    off = disagreement(recording.lidar, recording.ranges, recording.odometry, pairs, np.zeros_like(draft.poses))
    moved = np.flatnonzero(off > _MOVED)
    # It may have turned; a gyro that creeps while the robot rests is no harm.
    moved_pairs = Pairs(pairs.first[moved], pairs.second[moved])
    turned = disagreement(recording.lidar, recording.ranges, recording.odometry, moved_pairs, draft.poses)
    off[moved] = np.fmin(off[moved], turned)
    stuck = (off.reshape(4, -1) > _MOVED).sum(axis=0) >= 2
    if stuck.any():
        words, scan = told(stuck, starts, lasted)
        draft.add(
            "doubtful",
            "odometry_stands_still",
            f"odometry: stands still while the scans move, {words}",
            "look at the encoders or the odometry's source there",
            scan,
        )
