"""Closing loops while the robot drives: when the trajectory so far is to be settled anew, and what comes of it.

Four things are a reason to look back: the scans of an earlier visit do not match where the trajectory says they
should; a place is recognised that the trajectory has drifted away from; the filter went against odometry that has
proven right; and every so often the mere number of scans since the last time. Once there is more of a map, the mere
number is not, and visits only if they are far off: a correction on the way parts what comes after it from what came
before, by as much as it moves the robot, and where the filter fits its own map that is worse than a slight bend,
which the end settles. What is found is taken over only if scans that were not matched prefer it, as at the end of the
run. As in graph-based SLAM with a front end and a back end (Hess et al. 2016), where here the front end is the
particle filter.
"""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.graph.drift import match_deviation
from pfslam_viz.slam.graph.evidence import compare
from pfslam_viz.slam.graph.loop_closing import confirmed, find_candidates, search_loops
from pfslam_viz.slam.graph.odometry_errors import OdometryErrors
from pfslam_viz.slam.graph.pose_graph import Constraints, residuals
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import GraphConfig
from pfslam_viz.slam.graph.smoothing import Smoothed, Smoother, match_neighbours, neighbouring, visits_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

REFRESH = 1.2  # times as many matches, from which their deviation is found anew
NOTHING = Constraints(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, np.bool_)
)


class Reviser:
    """Looks at the key scans of a run as they come, and tells when hindsight knows better."""

    def __init__(self, config: GraphConfig) -> None:
        c = config.revision
        settled = {"settled_distance": c.settled_distance, "settled_angle": c.settled_angle}
        smoothing = config.smoothing.model_copy(update=settled)
        spans = config.filter_constraints.model_copy(update={"span_angle": c.span_angle})
        # For the smoother of revisions
        self.config = config.model_copy(update={"smoothing": smoothing, "filter_constraints": spans})
        self._seen = 0  # key scans looked at
        self._last = 0  # key scans there were at the last revision, taken over or not
        self._matched = NOTHING  # all neighbours, as they were matched when they came
        self._closures = NOTHING  # recognised places that nothing has confirmed yet
        self._slides = NOTHING  # visits among the key scans looked at last that are to slide along a corridor
        self._deviation, self._measured = np.zeros(2), 0  # of a match, and how many matches told it
        self.held, self._chosen = False, 0  # whether the filter's headings are held, as chosen at so many key scans
        self.visits = NOTHING  # matches of the key scans looked at last with earlier visits
        self.errors = OdometryErrors(config.odometry)  # as learned at the last revision
        self.misled = False  # whether matches were found to be wrong, as the smoother says
        self.moved = 0.0  # m, by the revision that moved a pose farthest
        self.closed: Indices = np.zeros((0, 2), np.int64)  # pairs of key scans whose loops were closed

    def is_due(self, count: int) -> bool:
        """Whether ``count`` key scans are enough to look at."""
        c = self.config
        return c.smoothing.enabled and c.revision.enabled and count >= max(self._seen + c.revision.every, 3)

    def revise(self, smoother: Smoother, poses: Array) -> Smoothed | None:
        """Look at the key scans since the last time; better key ``poses`` (k, 3) than these, if there are any.

        With the loops that were closed to get there, if any were.
        """
        c, n = self.config.revision, len(poses)
        off = self._look(smoother.scans, poses)
        searched = self.config.loop_closing.enabled and off is None
        loops = self._recognise(smoother, poses) if searched else self._slid(poses)
        self._seen = n
        since = n - self._last
        rested = since >= max(c.pause, c.pause_share * n)
        regular = n <= c.early and since >= max(c.pause, c.regular_share * self._last)
        if not loops and not regular and not (rested and (off or self._contradicts(smoother, poses))):
            return None
        smoother.share_walls(poses, self._last)
        self._last = n
        gates = np.array(self.config.smoothing.gates)
        smoother.learn_errors(poses)
        smoother.held = self.held
        start = smoother.straighten(poses)
        self.errors, self.misled = smoother.errors, smoother.misled
        if n >= max(c.first_choice, (1.0 + c.choice_share) * self._chosen):
            self._chosen = n
            revised, support = smoother.choose_held(start, c.choice_sure)
            self.held = smoother.held
        else:
            revised, support = smoother.relax(start, gates)
        revised, _, joined = smoother.close_best(revised, support, loops)
        if len(joined):
            self._closures = NOTHING  # if what comes of them is refused below, they need not be tried again
        moved = float(np.hypot(*(revised - poses)[:, :2].T).max())
        if moved < c.least_move:
            return None
        verdict = compare(smoother.scans, revised, poses, self.config.evidence)
        if verdict.sigmas < smoother.asked_of(revised, poses, c.sure):
            return None
        self.moved = max(self.moved, moved)
        self.closed = np.concatenate([self.closed, joined])
        return Smoothed(revised, joined)

    def _contradicts(self, smoother: Smoother, poses: Array) -> bool:
        """Whether the filter went against odometry that had proven right by the last revision since then."""
        return bool(smoother.doubted(poses, self.errors)[max(self._last - 1, 0) :].any())

    def _look(self, scans: ScanStore, poses: Array) -> bool | None:
        """Match the key scans since the last time with their neighbours: whether earlier visits are off.

        None where hardly one matches: the place is new, or not where the trajectory says.
        """
        c, s = self.config.revision, self.config.smoothing
        pairs = neighbouring(poses, s, self._seen)
        matched, self._slides = match_neighbours(scans, poses, pairs, np.array(s.first_gates), self.config)
        self._matched = Constraints.join([self._matched, matched])
        visits = self.visits = visits_of(matched, s)
        if len(visits) < c.fewest_visits:
            return None
        missed = residuals(poses, visits)
        far, turned = np.median(np.hypot(missed[:, 0], missed[:, 1])), np.median(np.abs(missed[:, 2]))
        shift, turn = (c.shift, c.turn) if len(poses) <= c.early else (c.late_shift, c.late_turn)
        return bool(far > shift or turned > turn)

    def _recognise(self, smoother: Smoother, poses: Array) -> list[Constraints]:
        """Loops that the key scans since the last time close, or confirm."""
        every = self.config.loop_closing.every
        later = np.arange(-(-self._seen // every) * every, len(poses), every)
        later = later[later > 0]
        if len(later) == 0:
            return []
        drift = smoother.drift_by(poses, self.closed, self._matched, self._deviation_of_matches(smoother, poses))
        candidates = find_candidates(poses, drift, later, self.config.loop_closing)
        found = search_loops(smoother.scans, poses, candidates, self.config.loop_closing)
        if len(found) == 0:
            return []
        self._closures = Constraints.join([self._closures, found])
        return confirmed(poses, self._closures, self.config.loop_closing)

    def _slid(self, poses: Array) -> list[Constraints]:
        """Loops that the key scans since the last time close along a corridor, or confirm."""
        if len(self._slides) == 0 or not self.config.loop_closing.enabled:
            return []
        self._closures = Constraints.join([self._closures, self._slides])
        return confirmed(poses, self._closures, self.config.loop_closing)

    def _deviation_of_matches(self, smoother: Smoother, poses: Array) -> Array:
        """From all matches so far; found anew only once there are many more: it changes little."""
        if len(self._matched) > REFRESH * self._measured:
            self._measured = len(self._matched)
            sound = smoother.sound(poses, self._matched)
            self._deviation = match_deviation(sound, self.config.smoothing.hops, self.config.drift)
        return self._deviation
