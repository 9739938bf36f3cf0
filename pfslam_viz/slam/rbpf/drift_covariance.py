"""How far the estimated pose may have drifted from the start: what the spread of the particles does not tell.

The particles of a Rao-Blackwellized filter say how well the robot knows its place in its own map. All their maps share
the errors that were made on the way, so their spread is far too small as a covariance of the pose in the frame of the
first one. That covariance is carried along here as an extended Kalman filter would (Smith, Self & Cheeseman 1990), to
first order: every motion from key scan to key scan adds its noise, an error of heading is a lever for all that follows,
and what the wheels' scale is off by, which changes slowly with slip, adds up wherever the scans do not say how far the
robot went. Coming back to an earlier place undoes it, in the directions that its walls tell.
"""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.graph.pose_graph import Constraints, residuals
from pfslam_viz.slam.rbpf.settings import UncertaintyConfig

Array = NDArray[np.float64]

LOOSE = 0.01  # 1/m², 1/rad²: information that stands for none


class DriftCovariance:
    """Covariances (4, 4) of all key poses, in the frame of the first: of x, y, heading and the odometry's scale."""

    def __init__(self, config: UncertaintyConfig) -> None:
        """At the first key scan, which is known but for the noise of a match."""
        self.config = config
        self._of = np.zeros((64, 4, 4))
        self._of[0] = np.diag([config.least_distance, config.least_distance, config.least_angle, config.scale]) ** 2
        self._count = 1

    @property
    def covariance(self) -> Array:
        """(3, 3) m², m rad, rad² of the last key pose."""
        return self._of[self._count - 1, :3, :3]

    def add(self, before: Array, pose: Array, increment: Array, odometry: Array, scans: Array) -> None:
        """A key scan at ``pose`` (3,), the one before it at ``before`` (3,), with ``increment`` (3,) in between.

        ``odometry`` and ``scans`` (3, 3) are the information that each has on the increment, in that scan's frame.
        """
        c = self.config
        noise = np.linalg.inv(odometry + c.scan_weight * scans)
        by_odometry = noise @ odometry  # its share in the increment, direction by direction
        turn = _rotation(before[2])
        carry = np.eye(4)
        carry[:3, :3] = _lever(pose - before)
        carry[:3, 3] = turn @ by_odometry @ [increment[0], increment[1], 0.0]
        kept = math.exp(-math.hypot(increment[0], increment[1]) / c.slip_length)
        forget = np.diag([1.0, 1.0, 1.0, kept])
        covariance = carry @ self._of[self._count - 1] @ carry.T
        covariance[:3, :3] += turn @ noise @ turn.T
        covariance = forget @ covariance @ forget
        covariance[3, 3] += (1.0 - kept**2) * c.slip**2
        if self._count == len(self._of):
            self._of = np.concatenate([self._of, np.zeros_like(self._of)])
        self._of[self._count] = covariance
        self._count += 1

    def come_back(self, poses: Array, visits: Constraints) -> None:
        """The last key scans match earlier ones: what is known there is known here, where ``poses`` (k, 3) agree."""
        missed = residuals(poses, visits)
        for k in np.flatnonzero(np.hypot(missed[:, 0], missed[:, 1]) < self.config.agree).tolist():
            self._revisit(poses, int(visits.start[k]), int(visits.end[k]), visits.information[k])

    def _revisit(self, poses: Array, earlier: int, later: int, information: Array) -> None:
        """Key scan ``later`` lies by ``information`` (3, 3), in its own frame, where it matches the ``earlier`` one."""
        c, last = self.config, self._count - 1
        turn = _rotation(poses[later, 2])
        match = np.linalg.inv(turn @ _known(information, c.known_share) @ turn.T + LOOSE * np.eye(3))
        match += np.diag([c.visit_distance, c.visit_distance, c.visit_angle]) ** 2
        there = _lever(poses[later] - poses[earlier])
        onward = _lever(poses[last] - poses[later])
        since = _positive(self.covariance - onward @ self._of[later, :3, :3] @ onward.T)
        back = onward @ (there @ self._of[earlier, :3, :3] @ there.T + match) @ onward.T + since
        now = self.covariance.copy()
        less = _smaller(now, back)
        self._of[last, :3, 3] = less @ np.linalg.solve(now, self._of[last, :3, 3])
        self._of[last, 3, :3] = self._of[last, :3, 3]
        self._of[last, :3, :3] = less


def _lever(away: Array) -> Array:
    """What errors of a pose (3, 3) do to one that is ``away`` (2,) or (3,) m from it."""
    return np.array([[1.0, 0.0, -away[1]], [0.0, 1.0, away[0]], [0.0, 0.0, 1.0]])


def _rotation(heading: float) -> Array:
    c, s = math.cos(heading), math.sin(heading)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _known(information: Array, share: float) -> Array:
    """A match's information without the direction of which it has less than ``share`` of what it has of the other.

    Uneven walls seem to tell a little of the way along them, and match anywhere.
    """
    cross = information[:2, 2]
    values, vectors = np.linalg.eigh(information[:2, :2] - np.outer(cross, cross) / max(information[2, 2], 1e-9))
    if values[0] >= share * values[1]:
        return information
    without = np.eye(3)
    without[:2, :2] -= np.outer(vectors[:, 0], vectors[:, 0])
    known: Array = without @ information @ without
    return known


def _positive(symmetric: Array) -> Array:
    """The same without its negative eigenvalues."""
    values, vectors = np.linalg.eigh(symmetric)
    positive: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return positive


def _smaller(one: Array, other: Array) -> Array:
    """Of two covariances the smaller one, in each of the directions that both have in common.

    Their errors are partly the same ones, so adding up their information would count it twice.
    """
    root = np.linalg.cholesky(one)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ other @ inverse.T)
    common = root @ vectors
    smaller: Array = (common * np.minimum(values, 1.0)) @ common.T
    return smaller
