"""What happened in a run, for the list of events: a level, a scan and a few words each.

The list beside the maps is narrow, and breaks no lines. What lasts (an open corridor, scans without a match) is told
where it begins, and how long it was where it ends.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording, Stream
from pfslam_viz.replay import Result
from pfslam_viz.step import Step

DETAIL, EVENT, DOUBT = "DEBUG", "INFO", "WARN"  # levels, as Rerun calls them
GAP_SECONDS, GAP_PERIODS = 1.0, 10.0  # a silence of both is a gap
MOST_GAPS = 10  # of a sensor, the longest
FLICKER = 10  # times as many scans without something end it as begin it
TOGETHER = 1.0  # s: sensors that fall silent no further apart are told as one
TELLING = 0.1  # m: a revision that moves the trajectory by more is an event, by less a detail
SAME_SCANS = 10  # loops whose later scans are no further apart, and doubts, are told as one


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened at scan ``step``, ``seconds`` after the first one."""

    step: int
    seconds: float
    level: str
    text: str
    closes_loop: bool = False

    @property
    def line(self) -> str:
        """With its scan, which the viewer's own column is too narrow for."""
        return f"{self.step:,}: {self.text}"


class Lasting:
    """Something that holds for some scans, flickers of it counted as one."""

    def __init__(self, begins: str, ends: str, at_least: int = 1) -> None:
        """``ends`` has {n} for how many scans it held. Told once it held for ``at_least`` scans in a row, and as over
        once it did not for ten times as many."""
        self._begins, self._ends, self._at_least = begins, ends, at_least
        self._in_a_row, self._quiet = 0, 0
        self._since: int | None = None

    def see(self, step: Step, holds: bool) -> Iterator[Event]:
        """Take the next scan."""
        self._in_a_row, self._quiet = (self._in_a_row + 1, 0) if holds else (0, self._quiet + 1)
        if self._since is None and self._in_a_row >= self._at_least:
            self._since = step.index - self._in_a_row + 1
            yield Event(step.index, step.time, DOUBT, self._begins)
        elif self._since is not None and self._quiet >= FLICKER * self._at_least:
            lasted = step.index - self._quiet + 1 - self._since
            self._since = None
            yield Event(step.index, step.time, EVENT, self._ends.format(n=f"{lasted:,} scan{'s' * (lasted > 1)}"))


class Chronicle:
    """Tells the events of the Steps as they come, and at the end those of the Result."""

    def __init__(self, recording: Recording, config: Config) -> None:
        self._recording, self._config = recording, config
        self._last: Step | None = None
        self._told: set[int] = set()  # later scans of loops that were closed on the way
        self._open = Lasting("corridor open", "corridor left, {n}", 3)
        self._blind = Lasting("no match with map", "matches again, {n}")
        self._deaf = Lasting("odometry unknown", "odometry back, {n}")
        self._gaps = sorted(gaps(recording), key=lambda event: event.step, reverse=True)

    def add(self, step: Step) -> Iterator[Event]:
        """What happened with this scan."""
        estimate, known = step.estimate, self._recording.odometry_known
        self._last = step
        while self._gaps and self._gaps[-1].step <= step.index:
            yield self._gaps.pop()
        yield from self._deaf.see(step, known is not None and not known[step.index])
        yield from self._blind.see(step, not estimate.informative and step.index > 0)  # the first makes the map
        yield from self._open.see(step, estimate.match is not None and estimate.match.degenerate is not None)
        if step.revision is not None:
            self._told |= {c.later for c in step.revision.closures}
            loops = f"loop closed with scan {step.revision.closures[0].earlier:,}, " if step.revision.closures else ""
            level = EVENT if loops or step.revision.moved > TELLING else DETAIL
            text = f"{loops}revised, moved by {step.revision.moved:.2f} m"
            yield Event(step.index, step.time, level, text, closes_loop=bool(loops))
        if estimate.resampled and self._config.resampling.policy != "always":
            share = f"N_eff {estimate.n_eff:.1f} of {len(estimate.weights):,}"
            yield Event(step.index, step.time, DETAIL, f"resampled, {share}")

    def finish(self, result: Result, painted_anew: bool) -> Iterator[Event]:
        """What is known only at the end: loops at their later scan, the rest at the last one."""
        if self._last is None:
            return
        last, times = self._last, result.stamps - self._recording.stamps[0]
        late = {c.later: c.earlier for c in reversed(result.closures) if c.later not in self._told}
        for scan in apart(sorted(late)):  # the others were closed on the way
            text = f"loop closed with scan {late[scan]:,}"
            yield Event(scan, float(times[scan]), EVENT, text, closes_loop=True)
        if result.interrupted:
            yield Event(last.index, last.time, DOUBT, "interrupted")
        moved = np.hypot(*(result.estimate - result.online)[:, :2].T)
        if moved.size and moved.max() > 1e-3:
            text = f"hindsight: by {moved.max():.2f} m"
            yield Event(last.index, last.time, EVENT, text)
        if result.kept is not None and result.kept.trajectory == "online":
            yield Event(last.index, last.time, EVENT, "run's trajectory kept")
        for scan in apart(result.kept.doubted if result.kept is not None else ()):
            yield Event(scan, float(times[scan]), DOUBT, "against good odometry")
        if painted_anew:
            yield Event(last.index, last.time, EVENT, "texture painted anew")


def apart(scans: Iterable[int]) -> Iterator[int]:
    """Those of ascending ``scans`` that are further from the last of these than what is told as one."""
    last: int | None = None
    for scan in scans:
        if last is None or scan - last > SAME_SCANS:
            last = scan
            yield scan


def gaps(recording: Recording) -> Iterator[Event]:
    """Where sensors fell silent while scans went on, or the lidar itself did; those that did so together are one."""
    streams: Sequence[Stream] = recording.streams or (Stream("lidar", recording.stamps),)
    first, end = float(recording.stamps[0]), float(recording.stamps[-1])
    found: list[tuple[float, float, str]] = []  # since when, for how long, which sensor
    for stream in streams:
        within = stream.stamps[(stream.stamps >= first) & (stream.stamps <= end)]
        silent = np.diff(within)
        if len(silent) < 2:
            continue
        long = np.flatnonzero(silent > max(GAP_SECONDS, GAP_PERIODS * float(np.median(silent))))
        longest = long[np.argsort(silent[long])[::-1][:MOST_GAPS]]
        found += [(float(within[k]), float(silent[k]), stream.name) for k in longest]
    found.sort()
    while found:
        since = found[0][0]
        together = [gap for gap in found if gap[0] - since <= TOGETHER]
        found = found[len(together) :]
        names = ", ".join(dict.fromkeys(name for _, _, name in together))
        step = int(np.searchsorted(recording.stamps, since, side="right")) - 1
        text = f"{names} silent {max(seconds for _, seconds, _ in together):.1f} s"
        yield Event(step, float(recording.stamps[step]) - first, DOUBT, text)
