"""What a recording writes where nothing came back: told from its readings, as files seldom declare it.

NaN, infinite, 0, negative and readings above the lidar's greatest range are no return by themselves. Many drivers
write the greatest range itself instead (8.00 m), or codes just above it (81.83 and 81.91 m, 51.14 and 51.15 m). Such a
value comes again and again from place to place, far more often than any range just below it, and hardly anything lies
beyond it. A wall does not: its range changes as the robot drives, so that each place that the robot was at counts once
here, however long it stood there.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.recording import Recording

Ranges = NDArray[np.float32]
Counts = NDArray[np.intp]

# Places are so far apart (m) by odometry; so many are looked at, and fewer tell nothing.
_APART = 0.25
_MOST_PLACES = 300
_FEWEST_PLACES = 5
# Ranges are told apart to a millimetre, up to a kilometre; what is beyond counts as that.
_CODES_PER_METER = 1000
_LAST_CODE = 1_000_000
# The least share of all readings that makes a value worth a look.
_LEAST_SHARE = 5e-4
# The same where the robot did not leave its place by odometry; and how far codes may lie apart then.
_LEAST_SHARE_AT_REST, _CODES_AT_REST = 0.02, 20
# A second value is below the first by more than the step in which ranges are written.
_NEXT = 0.9
# So many of the greatest values that come often are looked at.
_MOST_CANDIDATES = 30
# How much more often the value comes than any within so much of it below; and what share of it may lie beyond it.
_RATIO = 5.0
_BELOW = 0.05
_BEYOND = 0.02
# A median range (m) that asks for the unit.
_UNUSUAL = 50.0
# Two views are of one place if the quantiles of their ranges are within this (m), but for one of them.
_SAME_VIEW = 0.1
_QUANTILES = np.linspace(0.03, 0.97, 16)


@dataclass(frozen=True, slots=True)
class Sentinel:
    """A value that stands for no return: ``low`` to ``high`` m, the same where it is one value; ``share`` of all."""

    low: float
    high: float
    share: float

    def __str__(self) -> str:
        if self.low >= _LAST_CODE / _CODES_PER_METER:
            values = f"{self.low:.0f} m or more"
        elif self.high - self.low < 0.005:
            values = f"{self.low:.2f} m"
        else:
            values = f"{self.low:.2f} to {self.high:.2f} m"
        share = f"{100 * self.share:.0f}" if self.share >= 0.01 else f"{100 * self.share:.1g}"
        return f"lidar: no return is written as {values} ({share} % of the readings)"


def without_sentinels(recording: Recording) -> Recording:
    """The recording with a greatest range below the values that stand for no return; its notes name them.

    The ranges stay as they are. A recording without such values comes back itself.
    """
    lidar, notes = recording.lidar, list(recording.notes)
    limit = lidar.range_max
    for found in find(recording):
        if str(found) not in notes:
            notes.append(str(found))
        limit = min(limit, found.low - 0.5 / _CODES_PER_METER)
    if len(notes) == len(recording.notes) or limit <= lidar.range_min:
        return recording
    return replace(recording, lidar=replace(lidar, range_max=limit), notes=tuple(notes))


def find(recording: Recording) -> list[Sentinel]:
    """The values that stand for no return, the greatest first; those above the lidar's greatest range included."""
    places, apart = _places(recording)
    if len(places) < _FEWEST_PLACES:
        return []
    readings = recording.ranges[places]
    if _not_metres(readings):
        return []
    found: list[Sentinel] = []
    at_limit = 0.99 * recording.lidar.range_max * _CODES_PER_METER
    end, counted = _LAST_CODE + 1, 0
    for _ in range(3 if apart else 1):
        span = _spike(_histogram(readings, end), readings.size)
        if span is None:
            break
        low, high = span
        views = readings[_distinct_views(readings, low)]
        span = _spike(_histogram(views, end), views.size)
        if span is None or (_codes(views) >= span[0]).any(axis=1).sum() < _FEWEST_PLACES:
            break
        low, high = span
        if found and high > _NEXT * end:
            break
        if not ((readings > 0) & (readings < (low - 0.5) / _CODES_PER_METER)).any() and high < at_limit:
            break  # the one value there is, and not the lidar's greatest range: nothing to compare it with
        above = int(np.count_nonzero(recording.ranges >= (low - 0.5) / _CODES_PER_METER))
        share = (above - counted) / recording.ranges.size
        if not apart and (share < _LEAST_SHARE_AT_REST or high - low > _CODES_AT_REST):
            break
        counted = above
        end = low
        if low < _LAST_CODE or recording.lidar.range_max > low / _CODES_PER_METER:
            found.append(Sentinel(low / _CODES_PER_METER, high / _CODES_PER_METER, share))
    return found


def _not_metres(readings: Ranges) -> bool:
    """Whether most readings are farther than a lidar on a robot sees, and no code: their unit is to be told first."""
    some = readings[:: max(1, len(readings) // 50)]
    some = some[some > 0]
    return bool(len(some) and np.median(some) > _UNUSUAL and len(np.unique(some)) > 20)


def _places(recording: Recording) -> tuple[Counts, bool]:
    """Indices of scans from places apart from each other, and True; spread over the time where odometry rests."""
    steps = recording.odometry
    travelled = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))
    scans = np.flatnonzero(np.diff(np.floor(travelled / _APART), prepend=-1.0) > 0)
    apart = len(scans) >= _FEWEST_PLACES
    if not apart:
        scans = np.arange(len(recording))
    if len(scans) > _MOST_PLACES:
        scans = scans[np.linspace(0, len(scans) - 1, _MOST_PLACES).round().astype(np.intp)]
    return scans, apart


def _codes(readings: Ranges) -> Counts:
    """Readings in whole millimetres; 0 for what is none."""
    return np.rint(np.clip(readings, 0.0, _LAST_CODE / _CODES_PER_METER) * np.float64(_CODES_PER_METER)).astype(np.intp)


def _histogram(readings: Ranges, end: int) -> Counts:
    """How often each code below ``end`` occurs; what is no range at all is not counted."""
    codes = _codes(readings).ravel()
    counts: Counts = np.bincount(codes[(codes > 0) & (codes < end)])
    return counts


def _spike(counts: Counts, readings: int) -> tuple[int, int] | None:
    """The least and greatest code of the topmost peak of the histogram that stands for no return, or None."""
    least = max(float(_FEWEST_PLACES), _LEAST_SHARE * readings)
    for often in np.flatnonzero(counts >= least)[::-1][:_MOST_CANDIDATES]:
        span = _codes_about(counts, int(often))
        if span is not None and counts[span[1] + 1 :].sum() <= _BEYOND * counts[span[0] : span[1] + 1].sum():
            return span
    return None


def _codes_about(counts: Counts, often: int) -> tuple[int, int] | None:
    """The least and greatest code of a driver's about the one that comes ``often``; None if it does not stand out.

    They are neighbours: 51.14 and 51.15, 81.83 to 81.91 m.
    """
    width = min(0.01 * often, 100 + 0.003 * often)
    high = often + int(np.flatnonzero(counts[often : round(often + width) + 1])[-1])
    start = max(1, round(high - width))
    window, below = counts[start : high + 1], counts[round((1 - _BELOW) * start) : start]
    inside = start + np.flatnonzero(window >= max(0.01 * window.max(), _RATIO * below.max(initial=0), 3.0))
    if len(inside) == 0:
        return None
    if below.sum() <= 0.001 * counts[inside].sum():  # nothing but codes up there
        return start + int(np.flatnonzero(window)[0]), high
    return int(inside[0]), high


def _distinct_views(readings: Ranges, code: int) -> Counts:
    """Which of the scans (k, B) differ from the one kept before, by their ranges under ``code``.

    Odometry may creep while the robot stands. Scans that see next to nothing are kept: they cannot be compared.
    """
    kept: list[int] = []
    last: Ranges | None = None
    limit = (code - 0.5) / _CODES_PER_METER
    for k, scan in enumerate(readings):
        seen = scan[(scan > 0) & (scan < limit)]
        if len(seen) < 0.05 * len(scan):
            kept.append(k)
            continue
        view = np.sort(seen)[(_QUANTILES * (len(seen) - 1)).astype(np.intp)]
        if last is None or (np.abs(view - last) > _SAME_VIEW).sum() >= 2:
            kept.append(k)
            last = view
    return np.array(kept, np.intp)
