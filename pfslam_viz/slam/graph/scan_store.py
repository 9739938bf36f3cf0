"""Key scans, one after the other, and matching them with each other."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.scan_matching import MatchingRules, match_pairs
from pfslam_viz.slam.graph.settings import LoopClosingConfig, ScanMatchingConfig, SmoothingConfig
from pfslam_viz.slam.graph.shared_walls import shared_normals
from pfslam_viz.slam.graph.walls import describe, thinned
from pfslam_viz.slam.tiles import enlarged
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Matches:
    """k scan matches.

    Attributes:
        poses: (k, 3) of the matched scan in the reference's frame.
        information: (k, 3, 3) that the scans alone give on them, 1/m², 1/m rad, 1/rad².
        overlap: (k,) the share of end points that found a partner.
        distance: (k,) m, their mean distance from the partner's wall.
    """

    poses: Array
    information: Array
    overlap: Array
    distance: Array

    def pick(self, which: list[int]) -> "Matches":
        """Those at the positions ``which``."""
        return Matches(self.poses[which], self.information[which], self.overlap[which], self.distance[which])


@dataclass(frozen=True, slots=True)
class Described:
    """A scan as :class:`ScanStore` holds it: end points, normals and bearings (m, 5), and its normals' noise, rad²."""

    rows: Singles
    noise: float

    @classmethod
    def of(cls, points: Array, lidar_position: Array, config: ScanMatchingConfig) -> "Described":
        """Of the end points (m, 2), in the order of the beams; thinned where they lie close together."""
        points = thinned(points, config.most_points, config.sparse)
        rows = np.empty((len(points), 5), np.float32)
        reach, spacings = config.wall_reach, config.wall_spacings
        noise = describe(points, lidar_position, reach, spacings, config.wall_neighbours, config.wall_flatness, rows)
        return cls(rows, noise)


def trusted(found: Matches, guesses: Array, limits: SmoothingConfig | LoopClosingConfig) -> NDArray[np.bool_]:
    """Which matches (k,) are good enough, and near enough to their guesses (k, 3), to be believed."""
    moved = geometry.between(guesses, found.poses)
    return (
        (found.overlap > limits.overlap)
        & (found.distance < limits.distance)
        & (np.hypot(moved[:, 0], moved[:, 1]) < limits.longest_shift)
        & (np.abs(moved[:, 2]) < limits.largest_turn)
    )


class ScanStore:
    """Key scans, one after the other: end points with the normals of the walls they lie on, in the robot's frame.

    Attributes:
        lidar_position: (2,) m in the robot's frame.
        config: how scans are matched.
        points, normals, bearings: (p, 2) m, (p, 2), (p,) rad; a normal is zero where no wall fits, bearings are seen
            from the lidar and increase within a scan.
        own_normals: (p, 2), as each scan tells them alone; ``normals`` after :meth:`share_walls` are of several.
        first: scan k owns rows ``first[k]`` to ``first[k + 1]``.
        worker: who does a part of the matching.
    """

    def __init__(self, lidar_position: Array, config: ScanMatchingConfig, worker: Worker | None = None) -> None:
        """An empty store; a ``worker`` does its part of the matching."""
        self.lidar_position = lidar_position
        self.config = config
        self._rules = MatchingRules.of(config)
        self.worker = worker or Worker(threads=1)
        self._rows = np.zeros((1024, 5), np.float32)
        self._own_normals = np.zeros((1024, 2), np.float32)  # as each scan tells them alone
        self._first = np.zeros(64, np.int64)
        self._open_shares = np.zeros(64)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def points(self) -> Singles:
        """(p, 2) m."""
        return self._rows[:, 0:2]

    @property
    def normals(self) -> Singles:
        """(p, 2) unit vectors or zero."""
        return self._rows[:, 2:4]

    @property
    def own_normals(self) -> Singles:
        """(p, 2) unit vectors or zero, as each scan tells them alone."""
        return self._own_normals

    @property
    def bearings(self) -> Singles:
        """(p,) rad."""
        return self._rows[:, 4]

    @property
    def first(self) -> Indices:
        """(scans + 1,) row of each scan's first point, and one past the last."""
        return self._first[: self._count + 1]

    def points_of(self, scan: int) -> Array:
        """(m, 2) end points of one scan."""
        return self.points[self._first[scan] : self._first[scan + 1]].astype(np.float64)

    def add(self, scan: Array | Described) -> None:
        """Append a scan: its end points (m, 2), in the order of the beams, or what was made of them before."""
        c = self.config
        scan = scan if isinstance(scan, Described) else Described.of(scan, self.lidar_position, c)
        start = int(self._first[self._count])
        end = start + len(scan.rows)
        while end > len(self._rows):
            self._rows = enlarged(self._rows, len(self._rows))
            self._own_normals = enlarged(self._own_normals, len(self._own_normals))
        if self._count + 2 > len(self._first):
            self._first = np.concatenate([self._first, np.zeros_like(self._first)])
            self._open_shares = np.concatenate([self._open_shares, np.zeros_like(self._open_shares)])
        self._rows[start:end] = scan.rows
        self._own_normals[start:end] = scan.rows[:, 2:4]
        self._open_shares[self._count] = min(max(c.open_noise * scan.noise, c.open_least), c.open_share)
        self._count += 1
        self._first[self._count] = end

    def size_of(self, scan: int) -> int:
        """How many end points one scan has."""
        return int(self._first[scan + 1] - self._first[scan])

    def share_walls(self, poses: Array, since: int = 0) -> None:
        """Find the walls' directions anew from all scans that saw them, now that their ``poses`` (k, 3) are known.

        Those of the scans ``since`` that one, and of those before it whose walls these may have seen.
        """
        c = self.config
        if c.shared_scans == 0:
            return
        start, stop = max(since - c.shared_scans, 0), len(poses)
        rows, own, first, lidar = self._rows, self._own_normals, self.first, self.lidar_position
        limits = (c.shared_scans, c.shared_reach, c.wall_flatness, c.fewest_shared)

        def part(k: slice) -> Singles:
            return shared_normals(rows, own, first, lidar, poses, start + k.start, start + k.stop, *limits)

        found = self.worker.split(part, stop - start, worth=50)
        rows[first[start] : first[stop], 2:4] = np.concatenate(found)

    def drop_last(self) -> None:
        """Forget the scan added last."""
        self._count -= 1

    def match(
        self,
        references: Indices,
        others: Indices,
        guesses: Array,
        prior: Array,
        gates: Array,
        *,
        stride: int = 1,
        iterations: int,
    ) -> Matches:
        """Match scans ``others`` (k,) against ``references`` (k,); see :func:`match_pairs`."""
        references, others = np.ascontiguousarray(references), np.ascontiguousarray(others)

        def part(k: slice) -> tuple[Array, Array, Array, Array]:
            return match_pairs(
                self.points,
                self.normals,
                self.bearings,
                self.first,
                self.lidar_position,
                self._open_shares,
                references[k],
                others[k],
                guesses[k],
                gates,
                iterations,
                stride,
                prior,
                self._rules,
            )

        found = self.worker.split(part, len(references), worth=100)
        if len(found) == 1:
            return Matches(*found[0])
        return Matches(*(np.concatenate(values) for values in zip(*found, strict=True)))
