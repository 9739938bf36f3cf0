"""What happened in a run, for the list of events: a level, a scan and a sentence each.

What lasts (an open corridor, scans without a match) is told where it begins, and how long it was where it ends.
"""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording, Stream
from pfslam_viz.replay import Result
from pfslam_viz.step import Step

DETAIL, EVENT, DOUBT = "DEBUG", "INFO", "WARN"  # levels, as Rerun calls them
GAP_SECONDS, GAP_PERIODS = 1.0, 10.0  # a silence of both is a gap
MOST_GAPS = 10  # of a sensor, the longest
LINE = 30  # characters: the viewer breaks no lines in a list
SAME_SCANS = 10  # loops whose later scans are no further apart are told as one


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened at scan ``step``, ``seconds`` after the first one."""

    step: int
    seconds: float
    level: str
    text: str

    @property
    def line(self) -> str:
        """The sentence with its scan, broken as the narrow list beside the maps has to have it."""
        return textwrap.fill(f"scan {self.step:,}: {self.text}", LINE)


class Lasting:
    """Something that holds for some scans in a row."""

    def __init__(self, begins: str, ends: str, at_least: int = 1) -> None:
        """``ends`` names the number of scans as {n}. Told only once it lasted ``at_least`` scans."""
        self._begins, self._ends, self._at_least = begins, ends, at_least
        self._count = 0

    def see(self, step: Step, holds: bool) -> Iterator[Event]:
        """Take the next scan."""
        if holds:
            self._count += 1
            if self._count == self._at_least:
                yield Event(step.index, step.time, DOUBT, self._begins)
        elif self._count:
            if self._count >= max(self._at_least, 2):
                yield Event(step.index, step.time, EVENT, self._ends.format(n=f"{self._count:,}"))
            self._count = 0


class Chronicle:
    """Tells the events of the Steps as they come, and at the end those of the Result."""

    def __init__(self, recording: Recording, config: Config) -> None:
        self._recording, self._config = recording, config
        self._last: Step | None = None
        self._open = Lasting(
            "corridor open: the scan does not tell how far along the robot is", "placed again after {n} scans"
        )
        self._blind = Lasting("no match: the scan agrees with the map nowhere", "matches the map again after {n} scans")
        self._deaf = Lasting("odometry unknown: nothing is believed of it", "odometry back after {n} scans")
        self._gaps = sorted(gaps(recording), key=lambda event: event.step, reverse=True)

    def add(self, step: Step) -> Iterator[Event]:
        """What happened with this scan."""
        estimate, known = step.estimate, self._recording.odometry_known
        self._last = step
        while self._gaps and self._gaps[-1].step <= step.index:
            yield self._gaps.pop()
        yield from self._deaf.see(step, known is not None and not known[step.index])
        yield from self._blind.see(step, not estimate.informative)
        yield from self._open.see(step, estimate.match is not None and estimate.match.degenerate is not None)
        if estimate.resampled and self._config.resampling.policy != "always":
            share = f"N_eff {estimate.n_eff:.1f} of {len(estimate.weights):,}"
            yield Event(step.index, step.time, DETAIL, f"particles resampled: {share}")

    def finish(self, result: Result, painted_anew: bool) -> Iterator[Event]:
        """What is known only at the end: loops at their later scan, the rest at the last one."""
        if self._last is None:
            return
        last, times = self._last, result.stamps - self._recording.stamps[0]
        told: list[int] = []
        for closure in sorted(result.closures, key=lambda c: c.later):
            if not told or closure.later - told[-1] > SAME_SCANS:
                told.append(closure.later)
                text = f"loop closed (in hindsight): the same place as at scan {closure.earlier:,}"
                yield Event(closure.later, float(times[closure.later]), EVENT, text)
        if result.interrupted:
            yield Event(last.index, last.time, DOUBT, f"interrupted after {len(result.stamps):,} scans")
        moved = np.hypot(*(result.estimate - result.online)[:, :2].T)
        if moved.size and moved.max() > 1e-3:
            most = f"moved by up to {moved.max():.2f} m: the violet line"
            yield Event(last.index, last.time, EVENT, f"map settled in hindsight, the trajectory {most}")
        if result.kept is not None and result.kept.trajectory == "online":
            text = "trajectory of the run kept: the scans do not clearly speak for the settled one"
            yield Event(last.index, last.time, DOUBT, text)
        if painted_anew:
            yield Event(last.index, last.time, EVENT, "floor texture painted anew along the settled trajectory")


def gaps(recording: Recording) -> Iterator[Event]:
    """Where sensors fell silent while scans went on, or the lidar itself did."""
    streams: Sequence[Stream] = recording.streams or (Stream("lidar", recording.stamps),)
    first, end = float(recording.stamps[0]), float(recording.stamps[-1])
    for stream in streams:
        within = stream.stamps[(stream.stamps >= first) & (stream.stamps <= end)]
        silent = np.diff(within)
        if len(silent) < 2:
            continue
        long = np.flatnonzero(silent > max(GAP_SECONDS, GAP_PERIODS * float(np.median(silent))))
        for k in np.sort(long[np.argsort(silent[long])[::-1][:MOST_GAPS]]):
            step = int(np.searchsorted(recording.stamps, within[k], side="right")) - 1
            text = f"{stream.name}: silent for {silent[k]:.1f} s"
            yield Event(step, float(recording.stamps[step]) - first, DOUBT, text)
