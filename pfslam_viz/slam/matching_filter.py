"""The single-map filter with scan matching: the paper's filter, with a proposal that has seen the scan."""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config
from pfslam_viz.slam import kernels, motion, point_to_line, resampling
from pfslam_viz.slam.belief import Belief
from pfslam_viz.slam.protocol import Match, Scan
from pfslam_viz.slam.scan_matching import wall_normals
from pfslam_viz.slam.wall_map import WallMap

Array = NDArray[np.float64]

AT_REST = 1e-4  # m in one scan: a robot that moves less has stopped
STARTS = np.stack(np.meshgrid([0, -1, 1], [0, -1, 1], [0, -0.5, 0.5, -1, 1]), axis=-1).reshape(-1, 3)
MARGIN = 0.1  # a match that overrules the odometry must agree so much better
THIN = 4  # one end point in so many weighs the particles
WORTH = 0.1  # share of a key scan's motion after which a stop is worth a key scan


class MatchingFilter(Belief):
    """Particles (N, 3) that share one map, moved as a cloud to where the scan fits the map best, then weighed by it.

    A scan is used ("key scan") when the robot has moved on since the last one, or has stopped: it is matched, point to
    line, with the particles' own spread as prior; the cloud is moved by what the match changed; each particle is
    weighed by the scan's tempered likelihood and by how the move has changed its prior. Between key scans the
    particles follow the odometry. Particle 0 is the mode: it moves without noise, stands at the matched pose after a
    key scan, and draws the map.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config.particles, config.seed)
        self.config = config
        self.grid = WallMap(config.map, config.matching)
        self._log_weights = np.zeros(config.particles)
        self._driven = self._turned = 0.0
        self._moving = self._keyed = False
        self._normals = np.zeros((0, 2))
        self._online: list[Array] = []

    def predict(self, increment: Array, dt: float) -> None:
        """Move every particle by the odometry, all but the mode with noise of their own: (13), (17) to (19)."""
        moved = motion.predict(self._particles, increment, dt, self.config.motion, self._rng)
        moved[0] = kernels.compose(self._particles[0], increment)
        self._particles = moved
        distance = math.hypot(increment[0], increment[1])
        self._driven += distance
        self._turned += abs(float(increment[2]))
        self._moving = distance > AT_REST

    def update(self, scan: Scan) -> None:
        """Match a key scan with the map, move the cloud there and weigh it: (15), with (27)'s correlation replaced."""
        self._match, self._keyed, self._informative = None, self._is_key(), True
        if self._keyed:
            self._driven = self._turned = 0.0
            self._normals = wall_normals(scan.points, scan.origin, self.config.matching.wall_reach)
            if self._online:
                self._match_and_weigh(scan.points)
        weights = np.exp(self._log_weights - self._log_weights.max())
        self._weigh(weights / weights.sum(), best=0)  # the mode, at which the posterior is greatest
        self._parents, self._drawn = self._drawn, np.arange(len(weights))
        self._online.append(self.best)

    def _is_key(self) -> bool:
        m = self.config.matching
        share = max(self._driven / max(m.update_distance, 1e-9), self._turned / max(m.update_angle, 1e-9))
        return not self._online or share >= (1.0 if self._moving else WORTH)

    def _match_and_weigh(self, points: Array) -> None:
        m = self.config.matching
        on_wall = self._normals.any(axis=1)
        points, normals = points[on_wall], self._normals[on_wall]
        guess = self._particles[0]
        covariance = kernels.moments(*self._spread())[1]
        covariance += np.diag([m.least_distance**2, m.least_distance**2, m.least_angle**2])
        prior = np.asarray(np.linalg.inv(covariance), np.float64)
        pose, information, score, partners = self.grid.match(guess, prior, points, normals)
        if score < m.lost:
            wide = covariance + np.diag([m.lost_distance**2, m.lost_distance**2, m.lost_angle**2])
            wider = np.asarray(np.linalg.inv(wide), np.float64)
            found = self._search(guess, wider, points, normals)
            if found[2] > max(m.lost, score + MARGIN):
                prior, (pose, information, score, partners) = wider, found
        self._informative = bool(partners[:, 4].any())
        if not self._informative:
            return
        change = pose - guess
        open_direction = weakest_direction(information, m.degenerate)
        if open_direction is not None:  # the odometry knows better how far the robot has come along a bare wall
            change[:2] -= open_direction * (open_direction @ change[:2])
        before = geometry.between(np.append(guess[:2], 0.0), self._particles) - [0.0, 0.0, guess[2]]
        before[:, 2] = geometry.wrap(before[:, 2])
        after = before + change
        self._particles = self._particles + change
        self._particles[:, 2] = geometry.wrap(self._particles[:, 2])
        self._log_weights = (
            self._log_weights
            + m.temper
            * THIN
            * point_to_line.log_likelihoods(self._particles, points[::THIN], partners[::THIN], m.sigma)
            - 0.5 * np.einsum("ni,ij,nj->n", after, prior, after)
            + 0.5 * np.einsum("ni,ij,nj->n", before, prior, before)
        )
        self._match = Match(
            correction=geometry.between(guess, self._particles[0]), score=score, degenerate=open_direction
        )

    def _search(self, guess: Array, prior: Array, points: Array, normals: Array) -> tuple[Array, Array, float, Array]:
        """The best of the matches that start round the guess, as :meth:`WallMap.match` gives it."""
        m = self.config.matching
        found, best = None, -np.inf
        for start in STARTS * [m.lost_distance, m.lost_distance, m.lost_angle]:
            result = self.grid.match(guess, prior, points, normals, guess + start)
            away = result[0] - guess
            value = m.temper * point_to_line.log_likelihoods(result[0][None], points, result[3], m.sigma)[0]
            value -= 0.5 * float(away @ prior @ away)
            if value > best:
                found, best = result, value
        assert found is not None
        return found

    def _spread(self) -> tuple[Array, Array]:
        weights = np.exp(self._log_weights - self._log_weights.max())
        return self._particles, weights / weights.sum()

    def update_map(self, scan: Scan) -> None:
        """The mode writes a key scan into the map: (28), (29)."""
        if self._keyed:
            self.grid.add_scan(self.best, scan.points, self._normals, scan.origin)

    def resample(self) -> None:
        """Draw N particles anew if the policy says so, (30) to (32); the mode stays."""
        weights = self._weighed[1]
        self._resampled = self._keyed and resampling.is_due(weights, self.config.resampling)
        if self._resampled:
            self._drawn = resampling.SCHEMES[self.config.resampling.scheme](weights, self._rng)
            self._drawn[0] = 0
            self._particles = self._particles[self._drawn]
            self._log_weights = np.zeros(len(weights))

    def trajectory(self) -> Array:
        """(n, 3) the mode at every scan: one map keeps no other history."""
        return np.array(self._online).reshape(-1, 3)

    def finish(self) -> None:
        """Nothing is settled in hindsight."""


def weakest_direction(information: Array, share: float) -> Array | None:
    """The unit direction (2,) in which a match's information (3, 3) says least about the position, or None.

    None if even there it has at least ``share`` of what it has in both directions together; the heading is unknown.
    """
    place = information[:2, :2] - np.outer(information[:2, 2], information[2, :2]) / max(information[2, 2], 1e-12)
    values, vectors = np.linalg.eigh(place)
    return vectors[:, 0] if values[0] < share * values.sum() else None
