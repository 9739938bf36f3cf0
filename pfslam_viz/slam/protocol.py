"""What replay asks of a SLAM back end, and what it answers: back ends are interchangeable behind this."""

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.occupancy_grid import OccupancyGrid

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scan:
    """One lidar scan, cut to its usable beams.

    ``points`` (m, 2) float64 are the end points in the robot's frame, m, (22) with the lidar's position on the robot;
    ``lidar_position`` (2,) is the lidar there. ``index`` and ``stamp`` (s) are the recording's. ``prepared`` is what a
    back end has made of it already (:meth:`Slam.prepare`), and its own affair.
    """

    index: int
    stamp: float
    points: Array
    lidar_position: Array
    prepared: Any = None


@dataclass(frozen=True, slots=True)
class Match:
    """What matching the scan against the map changed.

    ``correction`` (3,) m, m, rad in the robot's frame, from the odometry's pose to the matched one; ``score`` in
    [0, 1], the mean agreement of end points with the map; ``degenerate`` (2,) is the unit direction in the world that
    the scan leaves open (a bare corridor's axis), or None.
    """

    correction: Array
    score: float
    degenerate: Array | None = None


@dataclass(frozen=True, slots=True)
class LoopClosure:
    """Two scans that were recognised as the same place: their indices, and their positions (2,) m in the world."""

    earlier: int
    later: int
    earlier_position: Array
    later_position: Array


@dataclass(frozen=True, slots=True)
class Revision:
    """What hindsight changed in mid-run: all particles and maps go on from there.

    ``trajectory`` (n, 3) holds a pose for every scan so far, ``closures`` are the loops that were closed, if that was
    the reason, and ``moved`` m is how far the pose that moved most went.
    """

    trajectory: Array
    closures: tuple[LoopClosure, ...]
    moved: float


@dataclass(frozen=True, slots=True)
class Kept:
    """Which of two trajectories was kept when all scans were in: that of the run, or the one settled in hindsight.

    ``gain`` is by how much more the scans agree with the settled one, as a share of a scan's end points, judged by
    scans that no fit had matched; ``sigmas`` is that over its standard error. The settled one is kept if the scans
    speak for it by as many as the settings ask for, else the ``online`` one; where that contradicts odometry that has
    proven right more often, the settled one is kept unless they speak against it clearly.
    ``doubted`` are the scans at which what was kept still contradicts it: one of the two is wrong there.
    """

    trajectory: Literal["settled", "online"]
    gain: float
    sigmas: float
    doubted: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Estimate:
    """A back end's belief after one scan.

    Attributes:
        particles: (N, 3) poses, before resampling where it happened (those that the weights belong to).
        weights: (N,) summing to 1.
        best: (3,) the most likely particle, "mode" in section I.
        mean: (3,) E(x), (33), heading by the circular mean.
        covariance: (3, 3) m², m rad, rad² of the mean: that of the particles, and where the back end knows by how much
            all of them may have drifted from the first pose, that too.
        n_eff: the effective sample size, (30): N when all weigh the same, 1 when one has all the weight.
        resampled: whether particles were resampled after this scan.
        informative: False when every correlation was zero, so that the weights stayed as they were.
        parents: (N,) the index of the particle in the previous step that each particle came from.
        match: what scan matching changed, if the back end matches.
    """

    particles: Array
    weights: Array
    best: Array
    mean: Array
    covariance: Array
    n_eff: float
    resampled: bool
    informative: bool
    parents: NDArray[np.intp]
    match: Match | None = None


class Slam(Protocol):
    """Algorithm 1 of the paper, as four calls a scan and one at the end; and one before, on another thread."""

    @property
    def grid(self) -> OccupancyGrid:
        """The map as known now: a live view, not a copy."""
        ...

    @property
    def best(self) -> Array:
        """(3,) the most likely particle after the last update."""
        ...

    def prepare(self, scan: Scan) -> Scan:
        """The scan with what can be told of it before its turn: called on any thread, and must change nothing else."""
        ...

    def predict(self, increment: Array, dt: float, known: bool = True) -> None:
        """Move the particles by the odometry ``increment`` (3,) of ``dt`` s, with noise: (13), (17) to (19).

        ``known`` is False where the odometry says nothing: then the increment is no better than any other.
        """
        ...

    def update(self, scan: Scan) -> None:
        """Weigh the particles by how well the scan fits the map: (15), (26), (27)."""
        ...

    def update_map(self, scan: Scan) -> None:
        """Write the scan into the map: (28), (29)."""
        ...

    def resample(self) -> None:
        """Resample the particles if it is time: (30) to (32)."""
        ...

    def revise(self) -> Revision | None:
        """Close loops: what hindsight makes of the trajectory and the map so far, if it knows better."""
        ...

    def estimate(self) -> Estimate:
        """The belief after the scan."""
        ...

    def trajectory(self) -> Array:
        """(n, 3) the whole trajectory as known now, a pose for every scan so far."""
        ...

    @property
    def settles(self) -> bool:
        """Whether :meth:`finish` may move the trajectory."""
        ...

    @property
    def closures(self) -> tuple[LoopClosure, ...]:
        """The loops that :meth:`finish` closed."""
        ...

    @property
    def kept(self) -> Kept | None:
        """Which trajectory :meth:`finish` kept; None if there was no choice."""
        ...

    def finish(self) -> None:
        """All scans are in: settle what can be settled in hindsight. The grid and the trajectory may change."""
        ...
