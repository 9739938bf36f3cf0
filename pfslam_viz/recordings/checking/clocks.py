"""Stamps that cannot be right: of another unit than seconds, off by hours, or of clocks that do not meet."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.checking.draft import Draft
from pfslam_viz.recordings.recording import Recording, Relations, Trajectory

Array = NDArray[np.float64]

UNITS = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
# A robot that drives goes faster than this at times: m/s and rad/s. One that seems slower has stamps of another unit.
_SLOW = 0.01
_FAST, _SPINS = 10.0, 20.0
# A stamp this far (s) from the rest is no pause of the drive, if just a scan or two stand there.
_HOUR = 600.0
_FEW = 3
# The columns of the odometry that come from a sensor.
_PARTS = {"encoders": slice(0, 2), "IMU": slice(2, 3)}


def check_unit(draft: Draft) -> None:
    """Stamps in ms, µs or ns become s where the odometry's speed tells the unit; doubted where nothing tells it."""
    recording = draft.recording
    if len(recording) < 5:
        return
    interval = float(np.median(np.diff(recording.stamps)))
    if interval < 2.0:
        return
    intervals = draft.intervals()
    speed = float(np.percentile(np.hypot(*recording.odometry[1:, :2].T) / intervals, 95))
    turning = float(np.percentile(np.abs(recording.odometry[1:, 2]) / intervals, 95))
    if speed >= _SLOW or turning >= 2 * _SLOW:
        return
    factor = _factor(interval)
    moves = max(speed, turning) > 1e-12
    fast, spins = speed / factor, turning / factor
    plausible = moves and max(fast, spins) > 2 * _SLOW and fast < _FAST and spins < _SPINS
    integers = bool((recording.stamps[:1000] == np.rint(recording.stamps[:1000])).all())
    if factor < 1.0 and (plausible or (not moves and integers and interval >= 5.0)):
        draft.mend(**in_seconds(recording, factor))
        draft.add(
            "note",
            f"stamps_in_{UNITS[factor]}",
            f"stamps: in {UNITS[factor]} ({interval:.6g} between scans); converted to seconds",
        )
        return
    seen = f"stamps: a scan every {interval:.6g} s, and a robot that never goes faster than {speed:.2g} m/s"
    advice = "give stamps in seconds"
    draft.add("wrong" if interval > 60.0 and moves else "doubtful", "stamps_of_unknown_unit", seen, advice)


def _factor(interval: float) -> float:
    """The seconds in a unit of which a scan's interval has so many: the largest that makes it 2 s or less."""
    return next((factor for factor in (1.0, *UNITS) if interval * factor <= 2.0), 1e-9)


def in_seconds(recording: Recording, factor: float) -> dict[str, object]:
    """The fields of a recording that hold stamps, times ``factor``."""
    frames, truth, relations = recording.frames, recording.truth, recording.relations
    return {
        "stamps": recording.stamps * factor,
        "streams": tuple(stream.scaled(factor) for stream in recording.streams),
        "truth": truth and Trajectory(truth.stamps * factor, truth.poses),
        "relations": relations and Relations(relations.start * factor, relations.end * factor, relations.poses),
        "frames": frames and frames.scaled(factor),
    }


def stray_stamps(stamps: Array) -> tuple[int, int]:
    """How many of the increasing ``stamps`` (n,) at the start and at the end are off by hours: one to three, or none.

    They are apart from all others by ten minutes and more, and by a hundred times what is usual.
    """
    if len(stamps) < 10:
        return 0, 0
    gaps = np.diff(stamps)
    far = gaps > max(_HOUR, 100.0 * float(np.median(gaps)))
    start = next((k + 1 for k in reversed(range(_FEW)) if far[k]), 0)
    end = next((k + 1 for k in reversed(range(_FEW)) if far[-1 - k]), 0)
    return start, end


def check_stray(draft: Draft) -> None:
    """Scans whose stamps are off by hours are left out; so are their steps of odometry, which nobody needs."""
    recording = draft.recording
    start, end = stray_stamps(recording.stamps)
    if start == end == 0:
        return
    last = len(recording) - end
    off = max(
        recording.stamps[start] - recording.stamps[0],
        recording.stamps[-1] - recording.stamps[last - 1],
    )
    scan = 0 if start else last
    draft.recording = recording.select(start, last)
    count = start + end
    what = "scan has a stamp" if count == 1 else "scans have stamps"
    draft.add(
        "doubtful",
        "stray_stamp",
        f"stamps: {count} {what} {off / 3600:.1f} h off the others; left out",
        "look at the clock that stamps the scans",
        scan,
    )


def check_streams(draft: Draft) -> None:
    """Sensors whose clock does not meet the lidar's tell nothing about its scans."""
    recording = draft.recording
    first, last = float(recording.stamps[0]), float(recording.stamps[-1])
    for stream in recording.streams:
        if stream.name not in ("odometry", "encoders", "IMU") or len(stream.stamps) < 2:
            continue
        stamps = stream.stamps
        start, end = stray_stamps(stamps)
        if start or end:
            draft.add("note", "stray_stamp", f"{stream.name}: {start + end} stamps are off the others by hours")
            stamps = stamps[start : len(stamps) - end]
        begin, until = float(stamps[0]), float(stamps[-1])
        outside = (recording.stamps[1:] < begin) | (recording.stamps[:-1] > until)
        part = _PARTS.get(stream.name, slice(0, 3))
        if not outside.any() or recording.odometry[1:, part][outside].any():
            continue  # the motion between the scans comes from elsewhere
        if begin > last or until < first:
            apart = begin - last if begin > last else first - until
            draft.add(
                "wrong",
                "clocks_do_not_overlap",
                f"{stream.name} and lidar do not overlap in time: they are {_span(apart)} apart",
                "are they of one drive? Bring both to one clock",
            )
            continue
        covered = min(until, last) - max(begin, first)
        if last - first > 5.0 and covered < 0.5 * (last - first):
            draft.add(
                "doubtful",
                "clocks_hardly_overlap",
                f"{stream.name}: covers {covered:.1f} s of the lidar's {last - first:.1f} s; taken to rest besides",
                "are they of one drive and one clock?",
            )


def _span(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 600 else f"{seconds / 3600:.2f} h"
