"""The filter with scan matching: in a corridor, beside a wall that is not there, and at rest."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.config import Config, load_config
from pfslam_viz.slam.matching_filter import MatchingFilter, weakest_direction
from pfslam_viz.slam.protocol import Scan

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def fast() -> Config:
    return load_config("fast")


def scan(k: int, points: Array) -> Scan:
    return Scan(k, 0.025 * k, points, np.zeros(2))


def room(x: float, y: float = 0.0) -> Array:
    """Walls at x = +-3 and y = +-2, seen without noise from (x, y), heading along x."""
    along, across = np.linspace(-3, 3, 300), np.linspace(-2, 2, 200)
    sides = [
        np.stack([along, np.full(300, 2.0)], axis=1), np.stack([np.full(200, 3.0), across], axis=1),
        np.stack([along, np.full(300, -2.0)], axis=1), np.stack([np.full(200, -3.0), across], axis=1),
    ]  # fmt: skip
    return np.vstack(sides) - [x, y]


def corridor() -> Array:
    """Two bare walls, 2 m apart, as far as the lidar sees: the same wherever the robot is along them."""
    along = np.linspace(-8, 8, 500)
    return np.vstack([np.stack([along, np.full(500, side)], axis=1) for side in (1.0, -1.0)])


def test_it_corrects_what_the_odometry_gets_wrong(fast: Config) -> None:
    """The wheels say 0.05 m a scan and no turn; the robot drives 0.04 m: after 20 scans the odometry is 0.2 m ahead."""
    slam = MatchingFilter(fast)
    for k in range(21):
        if k:
            slam.predict(np.array([0.05, 0.0, 0.002]), 0.1)
        slam.update(scan(k, room(0.04 * k)))
        slam.update_map(scan(k, room(0.04 * k)))
        slam.resample()
        estimate = slam.estimate()
    np.testing.assert_allclose(estimate.best, [0.8, 0, 0], atol=0.03)
    assert estimate.match is not None and estimate.match.correction[0] == pytest.approx(-0.01, abs=3e-3)
    assert estimate.match.degenerate is None and estimate.match.score > 0.9
    np.testing.assert_allclose(estimate.mean, estimate.best, atol=0.01)
    assert np.sqrt(np.diag(estimate.covariance))[:2].max() < 0.02
    np.testing.assert_array_equal(slam.trajectory()[-1], estimate.best)


def test_along_a_bare_corridor_the_odometry_decides(fast: Config) -> None:
    slam = MatchingFilter(fast)
    for k in range(11):
        if k:
            slam.predict(np.array([0.05, 0.004, 0.0]), 0.1)
        slam.update(scan(k, corridor()))
        slam.update_map(scan(k, corridor()))
        slam.resample()
    estimate = slam.estimate()
    assert estimate.best[0] == pytest.approx(0.5, abs=2e-3)  # along: as the wheels say
    assert estimate.best[1] == pytest.approx(0.0, abs=5e-3)  # across: as the walls say
    assert estimate.match is not None and estimate.match.degenerate is not None
    assert abs(estimate.match.degenerate[0]) == pytest.approx(1, abs=1e-3)
    assert math.sqrt(estimate.covariance[0, 0]) > 3 * math.sqrt(estimate.covariance[1, 1])


def test_scans_are_used_when_the_robot_has_moved_on_or_stopped(fast: Config) -> None:
    slam = MatchingFilter(fast)
    used = []
    steps = [0.0, 0.0, 0.01, 0.01, 0.02, 0.01, 0.0, 0.0, 0.0]
    position = 0.0
    for k, step in enumerate(steps):
        position += step
        if k:
            slam.predict(np.array([step, 0.0, 0.0]), 0.1)
        before = slam.grid.log_odds.copy()
        slam.update(scan(k, room(position)))
        slam.update_map(scan(k, room(position)))
        slam.resample()
        estimate = slam.estimate()
        used.append(estimate.map_updated)
        assert estimate.map_updated or np.array_equal(before, slam.grid.log_odds)
        assert (estimate.match is not None) == (estimate.map_updated and k > 0)
    assert used == [True, False, False, False, True, False, True, False, False]


def test_what_follows_the_robot_down_a_corridor_does_not_hold_it_back(fast: Config) -> None:
    """A few end points that move with the robot are all that says anything along the walls: too little to be heard."""
    companion = np.stack([np.full(6, 2.0), np.linspace(-0.05, 0.05, 6)], axis=1)
    seen = np.vstack([corridor()[:500], companion, corridor()[500:]])
    slam = MatchingFilter(fast)
    for k in range(11):
        if k:
            slam.predict(np.array([0.05, 0.0, 0.0]), 0.1)
        slam.update(scan(k, seen))
        slam.update_map(scan(k, seen))
        slam.resample()
    assert slam.estimate().best[0] == pytest.approx(0.5, abs=5e-4)


def test_a_failed_odometry_is_found_again(fast: Config) -> None:
    """The robot is turned by 0.3 rad and pushed 0.3 m while the wheels say 0.05 m: one scan brings it back."""
    slam = MatchingFilter(fast)
    slam.update(scan(0, room(0)))
    slam.update_map(scan(0, room(0)))
    slam.resample()
    slam.predict(np.array([0.05, 0.0, 0.0]), 0.1)
    c, s = math.cos(0.3), math.sin(0.3)
    slam.update(scan(1, room(0.25, 0.25) @ np.array([[c, -s], [s, c]])))
    estimate = slam.estimate()
    assert estimate.match is not None and estimate.match.score > 0.8
    np.testing.assert_allclose(estimate.best, [0.25, 0.25, 0.3], atol=0.05)


def test_scans_that_match_nothing_leave_the_weights(fast: Config) -> None:
    slam = MatchingFilter(fast)
    slam.update(scan(0, room(0)))
    slam.update_map(scan(0, room(0)))
    slam.resample()
    for k, points in ((1, np.zeros((0, 2))), (2, room(0) + 50)):
        slam.predict(np.array([0.05, 0.0, 0.0]), 0.1)
        slam.update(scan(k, points))
        slam.update_map(scan(k, points))
        slam.resample()
        estimate = slam.estimate()
        assert not estimate.informative and estimate.match is None and not estimate.resampled
        np.testing.assert_allclose(estimate.weights, 0.01)
        np.testing.assert_allclose(estimate.best, [0.05 * k, 0, 0], atol=1e-12)


def test_the_mode_stays_through_resampling(fast: Config) -> None:
    slam = MatchingFilter(fast)
    for k in range(6):
        if k:
            slam.predict(np.array([0.05, 0.0, 0.0]), 0.1)
        slam.update(scan(k, room(0.05 * k)))
        slam.update_map(scan(k, room(0.05 * k)))
        slam.resample()
        estimate = slam.estimate()
        assert estimate.parents[0] == 0
        np.testing.assert_array_equal(estimate.best, estimate.particles[0])
    assert estimate.resampled


def test_the_mode_stays_even_when_it_has_lost_its_weight(fast: Config) -> None:
    slam = MatchingFilter(fast)
    slam.update(scan(0, room(0)))
    poses, weights = np.arange(300.0).reshape(100, 3), np.eye(100)[7]
    slam._particles, slam._weighed = poses, (poses, weights)
    slam.resample()
    np.testing.assert_array_equal(slam._particles, poses[[0] + 99 * [7]])
    slam._particles, slam._log_weights = poses, np.log(weights + 1e-9)
    slam.update(scan(1, room(0)))  # the robot stands: weighed as they are
    estimate = slam.estimate()
    assert np.argmax(estimate.weights) == 7
    np.testing.assert_array_equal(estimate.best, poses[0])


def test_weakest_direction() -> None:
    turned = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]])
    direction = weakest_direction(turned @ np.diag([1.0, 500.0, 10.0]) @ turned.T, 0.01)
    assert direction is not None
    np.testing.assert_allclose(np.abs(direction), [0.6, 0.8])
    assert weakest_direction(np.diag([10.0, 500.0, 10.0]), 0.01) is None
    # What looks known along x is the heading's: a wall far ahead, seen at an angle that only the heading explains.
    coupled = np.array([[10.0, 0, 10.0], [0, 100.0, 0], [10.0, 0, 10.0]])
    np.testing.assert_allclose(np.abs(weakest_direction(coupled, 0.01)), [1, 0])
