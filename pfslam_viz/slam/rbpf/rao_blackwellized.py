"""The filter with a map per particle: Rao-Blackwellized SLAM (Doucet et al. 2000; Grisetti et al. 2007)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam import kernels, resampling
from pfslam_viz.slam.belief import Belief
from pfslam_viz.slam.graph.evidence import compare
from pfslam_viz.slam.graph.odometry_errors import OdometryErrors
from pfslam_viz.slam.graph.pose_graph import turned
from pfslam_viz.slam.graph.revision import Reviser
from pfslam_viz.slam.graph.scan_matching import open_direction
from pfslam_viz.slam.graph.scan_store import Described, Matches, ScanStore
from pfslam_viz.slam.graph.settings import GraphConfig
from pfslam_viz.slam.graph.smoothing import Smoother
from pfslam_viz.slam.graph.walls import within
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import Estimate, Kept, LoopClosure, Match, Revision, Scan
from pfslam_viz.slam.rbpf.best_map import BestMap
from pfslam_viz.slam.rbpf.drift_covariance import DriftCovariance
from pfslam_viz.slam.rbpf.history import History
from pfslam_viz.slam.rbpf.proposal import propose, spread_points, window
from pfslam_viz.slam.rbpf.settings import RbpfConfig
from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]

PIECES = 10  # in which particles are shared with the other thread: the fewer there are, the longer one waits for it


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
        self._reviser = Reviser(config)
        self._drift = DriftCovariance(config.uncertainty)
        self._smoothed: Array | None = None
        self._kept: Kept | None = None
        self._closures: tuple[LoopClosure, ...] = ()
        self._odometry = np.zeros(3)  # since the last key scan
        self._moved = np.zeros(3)  # the same, corrected by matching the scans
        self._still = True  # since the scan before
        self._errors = OdometryErrors(config.odometry)
        self._unknown = 0.0  # s since the last key scan of which the odometry says nothing
        self._velocity = np.zeros(3)  # m/s, m/s, rad/s as the scans saw it, in the robot's frame
        self._before, self._dt = self._moved, 0.0  # as it was at the scan before, and s since then
        self._keyed = False  # whether the last scan is a key scan
        self._leader = 0  # the most likely particle, or its first descendant
        self._driven = self._turned = 0.0  # m and rad since the last key scan
        self._grid = BestMap(config.map, self._maps)

    @property
    def grid(self) -> OccupancyGrid:
        """The most likely particle's map."""
        return self._grid

    def prepare(self, scan: Scan) -> Scan:
        """The scan with the walls in it."""
        return Scan(scan.index, scan.stamp, scan.points, scan.lidar_position, self._described(scan))

    def predict(self, increment: Array, dt: float, known: bool = True) -> None:
        """Carry every particle along with the odometry; its noise is sampled when a scan is used.

        Where the odometry is not ``known``, the robot is taken to go on as the scans saw it go.
        """
        self._before, self._dt = self._moved, dt
        if not known:
            self._unknown += max(dt, 0.0)
            increment = self._velocity * dt
        self._odometry = kernels.compose(self._odometry, increment)
        if known:
            increment = increment * np.array([self._errors.scale, self._errors.scale, 1.0])
        self._particles = kernels.move(self._particles, increment, np.zeros_like(self._particles))
        self._moved = kernels.compose(self._moved, increment)
        step, turn = float(np.hypot(increment[0], increment[1])), abs(float(increment[2]))
        self._driven += step
        self._turned += turn
        self._still = known and step < self._settings.still and turn < self._settings.still

    def update(self, scan: Scan) -> None:
        """If the robot has moved on, match the scan with every particle's map and weigh the particles by it."""
        s = self._settings
        first = len(self._history) == 0
        self._keyed = first or self._driven >= s.update_distance or self._turned >= s.update_angle
        self._match, self._informative = None, True
        self._remember(scan)
        if not first:
            motion = self._match_last()
            unseen = self._unseen_by_wheels(motion)
            lost = self._unknown > 0.0 and motion.overlap < s.scan_good
            self._keyed = self._keyed or unseen or lost
            self._follow(motion)
            self._informative = motion.overlap > 0.0
            if unseen or not self._still:
                self._moved = motion.increment
            if self._keyed:
                self._propose(scan, motion)
            else:
                self._scans.drop_last()
                if not self._still:
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
        """Take from the scans how the robot goes, in case that the odometry will not say."""
        if self._dt > 0.0 and motion.overlap >= self._settings.scan_overlap:
            now = geometry.between(self._before, motion.increment) / self._dt
            self._velocity = 0.5 * (self._velocity + now)

    def _remember(self, scan: Scan) -> None:
        if len(self._scans) == 0:
            self._scans = ScanStore(scan.lidar_position, self.config.scan_matching, self._worker)
        self._scans.add(scan.prepared or self._described(scan))

    def _described(self, scan: Scan) -> Described:
        points = within(scan.points, scan.lidar_position, self._settings.max_range)
        return Described.of(points, scan.lidar_position, self.config.scan_matching)

    def _unseen_by_wheels(self, motion: Motion) -> bool:
        """Whether the scans have moved on by more than makes a key scan though the odometry says less."""
        s, (x, y, turn) = self._settings, motion.increment
        far = math.hypot(x, y) >= s.scan_unseen * s.update_distance or abs(turn) >= s.scan_unseen * s.update_angle
        return far and motion.overlap > s.scan_good

    def _match_last(self) -> Motion:
        """Odometry and scans fused: how the robot moved from the last key scan to the scan that came last."""
        s = self._settings
        least = np.array([s.least_distance, s.least_distance, s.least_angle])
        position, heading = s.noise_distance * self._driven, s.noise_angle * self._turned + s.noise_drift * self._driven
        deviation = np.array([position, position, heading])
        deviation += self._unknown * np.array([s.unknown_speed, s.unknown_speed, s.unknown_turn])
        held = self._reviser.errors.held
        turning = min(self._errors.angle, held) if held < 1.0 else self._errors.angle
        known = least + deviation * np.array([self._errors.distance, self._errors.distance, turning])
        prior = known**-2
        found = self._best_match(np.minimum(prior / s.scan_prior**2, s.scan_loosest**-2.0))
        overlap = float(found.overlap[0])
        if overlap < s.scan_overlap or not self._believable(found, known):
            return Motion(self._moved, np.diag(prior), np.zeros((3, 3)), overlap)
        if self._keyed and overlap > s.scan_good and not self._unknown:
            self._errors.add(self._odometry, found.poses[0], found.information[0], least + deviation)
        return Motion(found.poses[0], np.diag(prior), s.scan_temper * found.information[0], overlap)

    def _best_match(self, hold: Array) -> Matches:
        """The scan that came last matched with the last key scan, from other headings too if need be.

        ``hold`` (3,) is the information that holds it to where the odometry puts it.
        """
        s = self._settings
        found = self._match_from(self._moved[None], hold)
        if found.overlap[0] > s.scan_good or not s.scan_turns:
            return found
        others = self._match_from(self._moved + np.array(s.scan_turns)[:, None] * np.array([0.0, 0.0, 1.0]), hold)
        best = int(np.argmax(others.overlap))
        return others.pick([best]) if others.overlap[best] > found.overlap[0] + s.scan_better else found

    def _match_from(self, starts: Array, hold: Array) -> Matches:
        s, last = self._settings, len(self._scans) - 1
        return self._scans.match(
            np.full(len(starts), last - 1),
            np.full(len(starts), last),
            starts,
            hold,
            np.array(s.scan_gates),
            stride=1 + self._scans.size_of(last) // s.scan_points,
            iterations=s.scan_iterations,
        )

    def _believable(self, found: Matches, deviation: Array) -> bool:
        """Whether a match may overrule the odometry, whose noise is ``deviation`` (3,).

        Wheels slip, so their errors have heavy tails (Student's t); but a match that lies far out has to explain so
        many more end points than the odometry's pose does.
        """
        s = self._settings
        noise = np.array([s.scan_noise_distance, s.scan_noise_distance, s.scan_noise_angle])
        away = geometry.between(self._moved, found.poses[0]) / np.hypot(deviation, noise)
        square = float(away @ away)
        if square < s.scan_near**2:
            return True
        last = len(self._scans) - 1
        gates = np.array(s.scan_gates[-1:])
        there = self._scans.match(
            np.array([last - 1]), np.array([last]), self._moved[None], np.ones(3), gates, iterations=0
        )
        explained = self._scans.size_of(last) * float(found.overlap[0] - there.overlap[0])
        gain = -s.temper * math.log(s.floor) * explained
        return gain > 0.5 * (s.scan_freedom + 3.0) * math.log1p(square / s.scan_freedom)

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
        apart = np.array([s.start_distance, s.start_angle])
        starts = window(np.linalg.inv(prior), apart, s.start_window, s.most_starts)
        steps = np.array([s.search_distance, s.search_angle])
        spread = np.array([s.sample_distance, s.sample_angle])
        normals = self._rng.standard_normal((n, s.samples, 3))
        maps = self._maps
        table, field, origin = maps.table, maps.field, maps.origin  # before there are two threads

        def part(k: slice) -> tuple[Array, Array]:
            return propose(
                table[k],
                field,
                origin,
                maps.cell,
                points,
                s.temper,
                guesses[k],
                prior,
                starts,
                apart,
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
        before = self._key_particles[best]
        self._drift.add(before, means[best], motion.increment, motion.odometry, motion.scans)
        by_odometry = geometry.compose(before, self._odometry)
        if axis is not None:
            axis = geometry.transform(np.array([0.0, 0.0, before[2]]), axis[None])[0]
        self._match = Match(geometry.between(by_odometry, means[best]), motion.overlap, axis)

    def update_map(self, scan: Scan) -> None:
        """Every particle writes a key scan into its own map, beside what comes until somebody looks at it."""
        if self._keyed:
            points = self._scans.points_of(len(self._scans) - 1)
            self._maps.write_beside(self._worker, self._particles, points, scan.lidar_position, self._leader)
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

    def estimate(self) -> Estimate:
        """The belief after the scan; its covariance is in the frame of the first pose, drift included."""
        return self._estimate(self._drift.covariance)

    def trajectory(self) -> Array:
        """(n, 3) the most likely particle's whole history, smoothed once all scans are in."""
        return self._history.trajectory(self._key_poses())

    def revise(self) -> Revision | None:
        """Close loops on the way: the likeliest particle's trajectory settled, if the scans clearly prefer it.

        All particles then go on from there, as far apart as they are, with the map that it makes.
        """
        if not self._keyed or not self._reviser.is_due(len(self._history)):
            return None
        before = self._history.key_poses(self._leader)
        revised = self._reviser.revise(self._smoother(self._reviser.config), before)
        self._drift.come_back(before, self._reviser.visits)
        if revised is None:
            return None
        particles, weights = self._weighed
        to, at = revised.poses[-1], before[-1]
        self._particles = self._key_particles = geometry.compose(to, geometry.between(at, self._particles))
        self._weighed = (geometry.compose(to, geometry.between(at, particles)), weights)
        self._best = geometry.compose(to, geometry.between(at, self._best))
        self._history.rebase(self._leader, revised.poses, self._particles)
        self._show_only(TileMaps(1, self._maps.settings))  # the old ones go first: they are as large as the new ones
        self._maps = self._redrawn(revised.poses)
        self._maps.spread(len(self._particles))
        self._grid.show(self._maps, self._leader)
        moved = float(np.hypot(*(revised.poses - before)[:, :2].T).max())
        return Revision(self.trajectory(), tuple(self._closure(int(a), int(b)) for a, b in revised.closed), moved)

    def _smoother(self, config: GraphConfig) -> Smoother:
        s = self._settings
        unknown = self._history.unknown() * [s.unknown_speed, s.unknown_speed, s.unknown_turn]
        found = self._history.increments(self._leader)
        smoother = Smoother(self._scans, self._history.odometry(), found, config, unknown)
        smoother.misled = self._reviser.misled
        return smoother

    def _redrawn(self, poses: Array) -> TileMaps:
        """One map of all key scans, as seen from ``poses`` (k, 3)."""
        maps = TileMaps(1, self._maps.settings)
        for k, pose in enumerate(poses):
            maps.write(pose[None], self._scans.points_of(k), self._scans.lidar_position)
        return maps

    def _show_only(self, maps: TileMaps) -> None:
        """Let go of the maps so far; the first of these is the one to look at."""
        self._maps = maps
        self._grid.show(maps, 0)

    def finish(self) -> None:
        """Settle the most likely particle's trajectory in hindsight, and write its map anew.

        Unless the scans do not prefer it to what the particle has: then that is kept.
        """
        if not self.config.smoothing.enabled or len(self._scans) == 0:
            return
        before = self._key_poses()
        smoother = self._smoother(self.config)
        smoothed = smoother.smooth(before)
        if self._reviser.moved > self.config.revision.doubtful:  # perhaps for the worse
            own = geometry.accumulate(np.vstack([before[:1], self._history.increments(self._leader)]))
            other = self._smoother(self.config).smooth(own)
            verdict = compare(self._scans, smoothed.poses, other.poses, self.config.evidence, visits_alike=True)
            if verdict.sigmas < self.config.revision.sure_of_doubtful:
                smoothed = other
        verdict = compare(self._scans, smoothed.poses, before, self.config.evidence, visits_alike=True)
        closed = self._reviser.closed
        settled = verdict.sigmas >= smoother.asked_of(smoothed.poses, before, self.config.evidence.preferred)
        if settled:
            self._smoothed = smoothed.poses
            closed = np.concatenate([closed, smoothed.closed])
            self._show_only(TileMaps(1, self._maps.settings))  # the old ones go first
            self._show_only(self._redrawn(smoothed.poses))
        doubted = tuple(self._history.keys[k + 1] for k in np.flatnonzero(smoother.doubted(self._key_poses())))
        self._kept = Kept("settled" if settled else "online", verdict.gain, verdict.sigmas, doubted)
        self._closures = tuple(self._closure(int(earlier), int(later)) for earlier, later in closed)

    @property
    def kept(self) -> Kept | None:
        """Which trajectory is left now that all scans are in, and why; None before, or if nothing was settled."""
        return self._kept

    @property
    def settles(self) -> bool:
        """Whether :meth:`finish` smooths the trajectory."""
        return self.config.smoothing.enabled

    @property
    def closures(self) -> tuple[LoopClosure, ...]:
        """The loops that were closed on the way and at the end."""
        return self._closures

    def _closure(self, earlier: int, later: int) -> LoopClosure:
        poses, keys = self._key_poses(), self._history.keys
        return LoopClosure(keys[earlier], keys[later], poses[earlier, :2].copy(), poses[later, :2].copy())

    def _key_poses(self) -> Array:
        if self._smoothed is not None:
            return self._smoothed
        return self._history.key_poses(self._leader)
