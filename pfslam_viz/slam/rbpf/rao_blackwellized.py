"""The filter with a map per particle: Rao-Blackwellized SLAM (Doucet et al. 2000; Grisetti et al. 2007)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam import kernels, resampling
from pfslam_viz.slam.belief import Belief
from pfslam_viz.slam.graph.pose_graph import turned
from pfslam_viz.slam.graph.scan_matching import open_direction
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.smoothing import Smoother
from pfslam_viz.slam.graph.walls import within
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import LoopClosure, Match, Scan
from pfslam_viz.slam.rbpf.best_map import BestMap
from pfslam_viz.slam.rbpf.history import History
from pfslam_viz.slam.rbpf.proposal import propose, spread_points
from pfslam_viz.slam.rbpf.settings import RbpfConfig
from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]

TURN_STEP = 0.15  # rad between the turns that are tried where the odometry says nothing: a match finds the rest
PIECES = 5  # in which particles are shared with the other thread: the fewer there are, the longer one waits for it


@dataclass(frozen=True, slots=True)
class Motion:
    """How the robot moved since the last key scan: increment (3,), in that scan's frame.

    ``odometry`` and ``scans`` (3, 3) are the information that each has on it, ``overlap`` how much of the scan matched,
    in [0, 1].
    """

    increment: Array
    odometry: Array
    scans: Array
    overlap: float


class RaoBlackwellizedFilter(Belief):
    """N hypotheses of the whole trajectory, each with the map that follows from it.

    A scan is used ("key scan") when the robot has moved on since the last one. In between, the particles go along with
    the motion that matching each scan with the last key scan finds; where that says nothing, the odometry does.
    """

    def __init__(self, config: RbpfConfig, worker: Worker | None = None) -> None:
        """A ``worker`` does its part of the matching; the results are the same."""
        super().__init__(config.particles, config.seed)
        self.config = config
        self._worker = worker or Worker(threads=1)
        self._settings = config.rao_blackwellized
        n = config.particles
        self._log_weights = np.zeros(n)
        self._maps = TileMaps(n, TileSettings.of(config))
        self._history = History(n)
        self._scans = ScanStore(np.zeros(2), config.scan_matching, self._worker)
        self._key_particles = self._particles
        self._smoothed: Array | None = None
        self._closures: tuple[LoopClosure, ...] = ()
        self._odometry = np.zeros(3)  # since the last key scan
        self._moved = np.zeros(3)  # the same, corrected by matching the scans
        self._still = True  # since the scan before
        self._keyed = False  # whether the last scan is a key scan
        self._leader = 0  # the most likely particle, or its first descendant
        self._driven = self._turned = 0.0  # m and rad since the last key scan
        self._unknown = 0.0  # s since the last key scan of which the odometry says nothing
        self._velocity = np.zeros(3)  # m/s, m/s, rad/s as the scans had it last, in the robot's frame
        self._dt = 0.0
        self._grid = BestMap(config.map, self._maps)

    @property
    def grid(self) -> OccupancyGrid:
        """The most likely particle's map."""
        return self._grid

    def predict(self, increment: Array, dt: float, known: bool = True) -> None:
        """Carry every particle along with the odometry; its noise is drawn when a scan is used.

        Where the odometry is not ``known``, the particles stay, and the scans say how the robot has moved.
        """
        self._dt = dt
        if not known:
            self._unknown += max(dt, 0.0)
            self._still = False
            return
        self._particles = kernels.move(self._particles, increment, np.zeros_like(self._particles))
        self._odometry = kernels.compose(self._odometry, increment)
        self._moved = kernels.compose(self._moved, increment)
        step, turn = float(np.hypot(increment[0], increment[1])), abs(float(increment[2]))
        self._driven += step
        self._turned += turn
        self._still = step < self._settings.still and turn < self._settings.still

    def update(self, scan: Scan) -> None:
        """If the robot has moved on, match the scan with every particle's map and weigh the particles by it."""
        s = self._settings
        first = len(self._history) == 0
        self._keyed = first or self._driven >= s.update_distance or self._turned >= s.update_angle
        self._match, self._informative = None, True
        if first:
            self._remember(scan)
        elif self._keyed or not self._still:
            self._remember(scan)
            motion = self._match_last()
            if self._unknown:
                self._follow(motion)
            self._moved = motion.increment
            self._informative = motion.overlap > 0.0
            if self._keyed:
                self._propose(scan, motion)
            else:
                self._scans.drop_last()
                self._particles = kernels.move(self._key_particles, self._moved, np.zeros_like(self._key_particles))
        weights = np.exp(self._log_weights - self._log_weights.max())
        self._weigh(weights / weights.sum())
        self._parents, self._ancestors = self._ancestors, np.arange(len(weights))
        if self._keyed:
            odometry = self._moved if self._unknown else self._odometry
            self._history.add_key(self._particles, odometry, self._moved, self._unknown)
            self._odometry, self._moved = np.zeros(3), np.zeros(3)
            self._driven = self._turned = self._unknown = 0.0
        self._history.add_scan(self._moved)

    def _follow(self, motion: Motion) -> None:
        """Take from the scans what the odometry does not say: how far the robot has come, and how fast it goes."""
        step = geometry.between(self._moved, motion.increment)
        if motion.overlap >= self._settings.scan_overlap and self._dt > 0.0:
            self._velocity = step / self._dt
        self._driven = max(self._driven, float(np.hypot(motion.increment[0], motion.increment[1])))
        self._turned = max(self._turned, abs(float(motion.increment[2])))
        self._keyed = self._driven >= self._settings.update_distance or self._turned >= self._settings.update_angle

    def _remember(self, scan: Scan) -> None:
        if len(self._scans) == 0:
            self._scans = ScanStore(scan.lidar_position, self.config.scan_matching, self._worker)
        self._scans.add(within(scan.points, scan.lidar_position, self._settings.max_range))

    def _match_last(self) -> Motion:
        """Odometry and scans fused: how the robot moved from the last key scan to the scan that came last."""
        s = self._settings
        deviation = np.array(
            [
                s.least_distance + s.noise_distance * self._driven,
                s.least_distance + s.noise_distance * self._driven,
                s.least_angle + s.noise_angle * self._turned + s.noise_drift * self._driven,
            ]
        )
        deviation += self._unknown * np.array([s.unknown_speed, s.unknown_speed, s.unknown_turn])
        prior = deviation**-2
        last = len(self._scans) - 1
        guesses = self._guesses()
        found = self._scans.match(
            np.full(len(guesses), last - 1),
            np.full(len(guesses), last),
            guesses,
            prior / s.scan_prior**2,
            np.array(s.scan_gates),
            stride=1 + self._scans.size_of(last) // s.scan_points,
            iterations=s.scan_iterations,
        )
        noise = self.config.scan_matching.noise
        best = int(np.argmax(found.overlap * noise / (noise + found.distance))) if len(guesses) > 1 else 0
        overlap = float(found.overlap[best])
        if overlap < s.scan_overlap:
            return Motion(self._moved, np.diag(prior), np.zeros((3, 3)), overlap)
        return Motion(found.poses[best], np.diag(prior), s.scan_temper * found.information[best], overlap)

    def _guesses(self) -> Array:
        """Where a match with the last key scan starts (g, 3): at the odometry's pose, or if that is not known all round.

        Then from the pose of the scan before, at rest, going on as it did, and turned to either side.
        """
        if not self._unknown:
            return self._moved[None]
        most = self._settings.unknown_turn * self._dt
        turns = np.linspace(-most, most, 2 * math.ceil(most / TURN_STEP) + 1)
        steps = np.zeros((len(turns) + 1, 3))
        steps[:-1, 2] = turns
        steps[-1] = self._velocity * self._dt
        return geometry.compose(self._moved, steps)

    def _propose(self, scan: Scan, motion: Motion) -> None:
        """Move every particle to the mean of its improved proposal, and weigh it by the evidence for it."""
        s, n = self._settings, len(self._particles)
        information = motion.odometry + motion.scans
        axis = open_direction(motion.scans)
        if axis is not None:  # unseen cells hold the particles back there: leave the odometry no more than its noise
            information[:2, :2] += (s.least_distance + s.noise_open * self._driven) ** -2 * np.outer(axis, axis)
        noise = self._rng.standard_normal((n, 3)) @ np.linalg.cholesky(np.linalg.inv(information)).T
        guesses = geometry.compose(self._key_particles, motion.increment + noise)
        points = spread_points(scan.points, scan.lidar_position, s.max_range, s.match_spacing, s.match_beams)
        prior = turned(information, motion.increment[2])
        steps = np.array([s.search_distance, s.search_angle])
        spread = np.array([s.sample_distance, s.sample_angle])
        normals = self._rng.standard_normal((n, s.samples, 3))
        maps = self._maps

        def part(k: slice) -> tuple[Array, Array]:
            return propose(
                maps.table[k],
                maps.field,
                maps.origin,
                maps.cell,
                points,
                s.temper,
                guesses[k],
                prior,
                steps,
                s.search_halvings,
                s.search_moves,
                normals[k],
                spread,
            )

        found = self._worker.split(part, n, worth=4, pieces=min(n, PIECES))
        means, evidence = (np.concatenate(values) for values in zip(*found, strict=True))
        means[:, 2] = geometry.wrap(means[:, 2])
        self._particles = means
        self._log_weights = self._log_weights + evidence
        best = self._leader = int(np.argmax(self._log_weights))
        by_odometry = geometry.compose(self._key_particles[best], self._odometry)
        if axis is not None:
            axis = geometry.transform(np.array([0.0, 0.0, self._key_particles[best, 2]]), axis[None])[0]
        self._match = Match(geometry.between(by_odometry, means[best]), motion.overlap, axis)

    def update_map(self, scan: Scan) -> None:
        """Every particle writes a key scan into its own map."""
        if self._keyed:
            self._maps.write(self._particles, self._scans.points_of(len(self._scans) - 1), scan.lidar_position)
            self._grid.follow(self._leader)

    def resample(self) -> None:
        """Resample the particles if it is time, (30) to (32)."""
        weights = self._weighed[1]
        self._resampled = self._keyed and resampling.is_due(weights, self.config.resampling)
        if self._resampled:
            self._ancestors = resampling.SCHEMES[self.config.resampling.scheme](weights, self._rng)
            self._particles = self._particles[self._ancestors]
            self._log_weights = np.zeros(len(weights))
            self._maps.resample(self._ancestors)
            self._history.resample(self._ancestors)
        if self._keyed:
            self._key_particles = self._particles
        if self._resampled:
            self._leader = int(np.argmax(self._ancestors == self._leader))
            self._grid.follow(self._leader)

    def trajectory(self) -> Array:
        """(n, 3) the most likely particle's whole history, smoothed once all scans are in."""
        return self._history.trajectory(self._key_poses())

    def finish(self) -> None:
        """Settle the most likely particle's trajectory in hindsight, and write its map anew."""
        if not self.config.smoothing.enabled or len(self._scans) == 0:
            return
        s = self._settings
        unknown = self._history.unknown() * [s.unknown_speed, s.unknown_speed, s.unknown_turn]
        smoother = Smoother(
            self._scans, self._history.odometry(), self.config.smoothing, self.config.loop_closing, unknown
        )
        smoothed = smoother.smooth(self._key_poses())
        self._smoothed = smoothed.poses
        self._closures = tuple(self._closure(int(earlier), int(later)) for earlier, later in smoothed.closed)
        maps = TileMaps(1, self._maps.settings)
        for k, pose in enumerate(self._smoothed):
            maps.write(pose[None], self._scans.points_of(k), self._scans.lidar_position)
        self._grid.show(maps, 0)

    @property
    def settles(self) -> bool:
        """Whether :meth:`finish` smooths the trajectory."""
        return self.config.smoothing.enabled

    @property
    def closures(self) -> tuple[LoopClosure, ...]:
        """The loops that smoothing closed."""
        return self._closures

    def _closure(self, earlier: int, later: int) -> LoopClosure:
        poses, keys = self._key_poses(), self._history.keys
        return LoopClosure(keys[earlier], keys[later], poses[earlier, :2].copy(), poses[later, :2].copy())

    def _key_poses(self) -> Array:
        if self._smoothed is not None:
            return self._smoothed
        return self._history.key_poses(self._leader)
