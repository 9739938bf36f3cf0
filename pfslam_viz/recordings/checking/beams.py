"""Ranges and angles that cannot be right: of another unit, without any return, or kilometres away."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.checking.agreement import disagreement, explains_better, pairs_apart
from pfslam_viz.recordings.checking.draft import Draft
from pfslam_viz.recordings.checking.odometry import LENGTHS
from pfslam_viz.recordings.checking.stretches import stretches, told
from pfslam_viz.recordings.no_return import without_sentinels
from pfslam_viz.recordings.recording import Lidar, Recording
from pfslam_viz.recordings.sweep import with_beam_times

Array = NDArray[np.float64]

TURN = 2 * np.pi
# Ranges (m) that no lidar on a robot on the ground has as its median; and where one starts to ask for the unit.
_TYPICAL, _UNUSUAL = 200.0, 50.0
# A return is strange if it is this many times as far as nearly all others, and farther than so many m.
_BEYOND, _FAR = 10.0, 200.0
_SAMPLE = 60_000  # ranges that are looked at to know what is usual


def check_angles(draft: Draft) -> None:
    """Beams that go round more than once are in degrees, if those go round at most once."""
    lidar = draft.recording.lidar
    span = float(np.ptp(lidar.angles))
    if span <= 1.05 * TURN:
        return
    if span <= 361.0 and np.abs(lidar.angles).max() <= 721.0:
        draft.mend(lidar=replace(lidar, angles=np.radians(lidar.angles)))
        draft.add("note", "angles_in_degrees", f"lidar: beam angles over {span:.6g} are degrees; converted to radians")
        return
    draft.add(
        "wrong",
        "angles_beyond_a_turn",
        f"lidar: the beams span {span:.6g} rad, {span / TURN:.1f} turns",
        "give beam angles in radians, -pi to pi or 0 to 2 pi",
    )


def check_unit(draft: Draft) -> None:
    """Ranges in mm or cm become m, where limits or the robot's motion tell the unit; else they are refused."""
    recording = draft.recording
    lidar, ranges = recording.lidar, recording.ranges
    read = _sample(ranges)
    read = read[read > 0]
    if len(read) < 20 or len(np.unique(read[:2000])) < 20:
        return  # nothing, or an error code or two
    usual = float(np.median(read))
    if lidar.range_min >= 1.0 and lidar.range_max >= 1000.0 and (read < lidar.range_min).mean() > 0.9:
        _mend_limits(draft)
        return
    above = float((read > lidar.range_max).mean())
    if above > 0.9:
        fits = [f for f in LENGTHS if (read * f <= 1.05 * lidar.range_max).mean() > 0.95 and usual * f > 0.2]
    elif usual > _UNUSUAL:
        fits = [f for f in LENGTHS if 0.2 < usual * f < _UNUSUAL]
    else:
        return
    if len(fits) != 1 or above <= 0.9:
        fits = [f for f in fits if _moves_as(recording, f, above > 0.9)]
    if len(fits) == 1:
        factor, unit = fits[0], LENGTHS[fits[0]]
        farthest = lidar.range_max if above > 0.9 else lidar.range_max * factor
        nearest = lidar.range_min if above > 0.9 else lidar.range_min * factor
        draft.mend(ranges=ranges * np.float32(factor), lidar=replace(lidar, range_min=nearest, range_max=farthest))
        draft.add(
            "note",
            f"ranges_in_{unit}",
            f"lidar: ranges in {unit} (half of them above {usual:.4g}); converted to metres",
        )
    elif above > 0.9 or usual > _TYPICAL:
        limit = f", and range_max is {lidar.range_max:.6g} m" if above > 0.9 else ""
        draft.add(
            "wrong",
            "ranges_of_unknown_unit",
            f"lidar: half of the ranges are above {usual:.6g} m{limit}",
            "give ranges and their limits in metres",
        )


def _mend_limits(draft: Draft) -> None:
    lidar = draft.recording.lidar
    draft.mend(lidar=replace(lidar, range_min=lidar.range_min / 1000, range_max=lidar.range_max / 1000))
    draft.add(
        "note",
        "range_limits_in_millimetres",
        f"lidar: range limits {lidar.range_min:g} to {lidar.range_max:g} are millimetres; converted to metres",
    )


def _moves_as(recording: Recording, factor: float, limits_hold: bool) -> bool:
    """Whether the scans move as the odometry says if their ranges are times ``factor``, and less so as they are."""
    pairs = pairs_apart(recording.odometry)
    lidar = recording.lidar
    farthest = lidar.range_max if limits_hold else max(lidar.range_max, 1.0) * factor

    def fit(f: float, limit: float) -> Array:
        limits = Lidar(lidar.angles, 1e-3, limit, lidar.pose)
        return disagreement(limits, recording.ranges, recording.odometry, pairs, scale=f)

    given = fit(factor, farthest)
    others = [f for f in (1.0, *LENGTHS) if f != factor]
    return all(explains_better(given, fit(f, max(float(recording.ranges.max()), 1.0))) for f in others)


def check_no_return(draft: Draft) -> None:
    """Values that stand for no return are told from the readings, and lie above the lidar's greatest range then."""
    found = without_sentinels(draft.recording)
    _take(draft, found, "no_return_value", lidar=found.lidar)


def check_sweep(draft: Draft) -> None:
    """When each beam was measured is told from the drive, where that makes scans agree better."""
    found = with_beam_times(draft.recording)
    _take(draft, found, "beam_times", beam_times=found.beam_times)


def _take(draft: Draft, found: Recording, what: str, **changes: object) -> None:
    """Take ``changes`` over from ``found`` where it is another recording, and its new notes as findings."""
    if found is draft.recording:
        return
    notes = found.notes[len(draft.recording.notes) :]
    draft.mend(**changes)
    for note in notes:
        draft.add("note", what, note)


def check_far(draft: Draft) -> None:
    """Single returns kilometres away, far beyond all others, become no return: a map that held them would not fit."""
    recording = draft.recording
    lidar = recording.lidar
    if lidar.range_max <= _FAR:
        return
    sample = _sample(recording.ranges)
    returns = np.sort(sample[(sample >= lidar.range_min) & (sample <= lidar.range_max)])
    if len(returns) == 0:
        return
    nearly_all = float(returns[int((0.999 if len(returns) > 20_000 else 0.99) * (len(returns) - 1))])
    limit = max(_BEYOND * nearly_all, _FAR)
    strange = (recording.ranges > limit) & (recording.ranges <= lidar.range_max)
    count = int(strange.sum())
    if count:
        scan = int(np.argmax(strange.any(axis=1)))
        farthest = float(recording.ranges[strange].max())
        kept = recording.ranges.copy()
        kept[strange] = 0.0
        draft.mend(ranges=kept, lidar=replace(lidar, range_max=limit))
        draft.add(
            "note",
            "ranges_far_beyond",
            f"lidar: {count} {'range' if count == 1 else 'ranges'} of up to {farthest:,.0f} m, where nearly all are"
            f" below {nearly_all:.1f} m, taken as no return",
            scan=scan,
        )


def check_returns(draft: Draft) -> None:
    """A recording without a return cannot be replayed; one with long stretches without any is doubtful."""
    recording = draft.recording
    blind = _blind(recording)
    if blind.all():
        draft.add(
            "wrong",
            "no_returns",
            "lidar: no scan has a return within the range limits"
            f" {recording.lidar.range_min:g} to {recording.lidar.range_max:g} m",
            "look at the unit of the ranges and at the limits",
        )
        return
    starts, ends = stretches(blind)
    if len(starts) == 0:
        return
    lasted = recording.stamps[np.minimum(ends, len(recording) - 1)] - recording.stamps[starts]
    long = (lasted > 5.0) & (ends - starts >= 10)
    if long.any():
        words, scan = told(long, starts, lasted)
        draft.add(
            "doubtful",
            "scans_without_returns",
            f"lidar: {int(blind.sum()):,} scans without a return, {words}",
            "the map rests on odometry alone there",
            scan,
        )


def _blind(recording: Recording) -> NDArray[np.bool_]:
    """Which scans (n,) have no return. Looks at all beams only where a few of them say nothing."""
    low, high = recording.lidar.range_min, recording.lidar.range_max

    def none(ranges: NDArray[np.float32]) -> NDArray[np.bool_]:
        return np.asarray(~((ranges >= low) & (ranges <= high)).any(axis=1))

    blind = none(recording.ranges[:, :: max(1, recording.ranges.shape[1] // 16)])
    suspects = np.flatnonzero(blind)
    blind[suspects] = none(recording.ranges[suspects])
    return blind


def _sample(ranges: NDArray[np.float32]) -> NDArray[np.float32]:
    """Some of the ranges, of scans throughout and of all directions."""
    scans = max(1, ranges.size // _SAMPLE)
    sample: NDArray[np.float32] = ranges[::scans].ravel()
    return sample
