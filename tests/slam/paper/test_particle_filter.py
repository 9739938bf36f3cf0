"""The paper's filter, step by step, on a room of four walls."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from pfslam_viz.settings import MapConfig, ResamplingConfig
from pfslam_viz.slam.paper.particle_filter import ParticleFilter
from pfslam_viz.slam.paper.settings import MotionConfig, PaperConfig
from pfslam_viz.slam.protocol import Scan

STILL = np.zeros(3)


def config(**settings: Any) -> PaperConfig:
    values: dict[str, Any] = {
        "particles": 4,
        "motion": MotionConfig(variance=(0.0, 0.0, 0.0)),
        "map": MapConfig(cell=0.5),
    }
    return PaperConfig(**(values | settings))


def scan_of(*points: tuple[float, float], index: int = 0) -> Scan:
    return Scan(index, 0.0, np.array(points, np.float64).reshape(-1, 2), np.zeros(2))


def place(slam: ParticleFilter, poses: Sequence[tuple[float, float, float]], weights: list[float]) -> None:
    slam._particles, slam._weights = np.array(poses), np.array(weights)


def filter_with_a_map(**settings: Any) -> ParticleFilter:
    """Occupied cells at (1.75, 0.25) and (0.25, 2.25), in cells of 0.5 m; the robot is at (0.25, 0.25)."""
    slam = ParticleFilter(config(**settings))
    slam.grid.add(np.array([0.25, 0.25, 0.0]), np.array([[1.5, 0.0], [0.0, 2.0]]), np.zeros(2))
    return slam


def test_everything_starts_at_the_origin_with_equal_weights_and_no_map() -> None:
    slam = ParticleFilter(config())
    slam.update(scan_of((1.0, 0.0)))
    estimate = slam.estimate()
    np.testing.assert_array_equal(estimate.particles, np.zeros((4, 3)))
    np.testing.assert_array_equal(estimate.weights, np.full(4, 0.25))
    assert not estimate.informative and not slam.grid.log_odds.any()


def test_weights_are_multiplied_by_the_correlation() -> None:
    """(26), (27): correlations 2, 1, 0 and 2 with weights 0.1, 0.4, 0.4, 0.1 give 0.2, 0.4, 0, 0.2 over 0.8."""
    slam = filter_with_a_map()
    place(slam, [(0.25, 0.25, 0), (0.25, 0.75, 0), (5, 5, 0), (0.3, 0.2, 0)], [0.1, 0.4, 0.4, 0.1])
    slam.update(scan_of((1.5, 0.0), (0.0, 2.0), (0.0, 1.5)))
    estimate = slam.estimate()
    np.testing.assert_allclose(estimate.weights, [0.25, 0.5, 0.0, 0.25])
    assert estimate.informative
    np.testing.assert_array_equal(estimate.best, [0.25, 0.75, 0])
    np.testing.assert_allclose(estimate.mean, [0.25 * 0.25 + 0.5 * 0.25 + 0.25 * 0.3, 0.25 * 0.25 + 0.375 + 0.05, 0])
    assert estimate.n_eff == pytest.approx(1 / 0.375)


def test_all_zero_correlation_leaves_the_weights_and_says_so() -> None:
    slam = filter_with_a_map()
    place(slam, [(5, 5, 0), (6, 6, 0), (7, 7, 0), (8, 8, 0)], [0.1, 0.2, 0.3, 0.4])
    slam.update(scan_of((1.5, 0.0)))
    estimate = slam.estimate()
    np.testing.assert_array_equal(estimate.weights, [0.1, 0.2, 0.3, 0.4])
    assert not estimate.informative
    np.testing.assert_array_equal(estimate.best, [8, 8, 0])


def test_the_mean_heading_is_circular() -> None:
    """Headings 170° and -170° average to 180°, not to 0."""
    slam = ParticleFilter(config(particles=2))
    place(slam, [(0, 0, math.radians(170)), (0, 0, math.radians(-170))], [0.5, 0.5])
    slam.update(scan_of())
    estimate = slam.estimate()
    assert abs(estimate.mean[2]) == pytest.approx(math.pi)
    assert estimate.covariance[2, 2] == pytest.approx(math.radians(10) ** 2)


def test_the_best_particle_writes_the_map() -> None:
    """(28): by the most likely particle, not by the mean."""
    slam = filter_with_a_map()
    place(slam, [(0.25, 0.25, 0), (9.25, 9.25, math.pi / 2), (9.25, 9.25, 0), (5, 5, 0)], [0.1, 0.6, 0.2, 0.1])
    before = slam.grid.log_odds.sum()
    slam.update(scan_of((30.0, 0.0)))
    slam.update_map(scan_of((3.0, 0.0)))
    i, j = slam.grid.cells([[9.25, 12.25]])[0]
    assert slam.grid.occupied[i, j] == 1 and slam.grid.log_odds.sum() != before
    i, j = slam.grid.cells([[12.25, 9.25]])[0]
    assert slam.grid.log_odds[i, j] == 0


def test_resampling_copies_the_likely_and_levels_the_weights() -> None:
    """(31), (32): all the weight on one particle makes N copies of it; the step still shows who was weighed."""
    slam = filter_with_a_map(resampling=ResamplingConfig(policy="n_eff", scheme="systematic"))
    poses = [(5, 5, 0), (0.25, 0.25, 0), (6, 6, 0), (7, 7, 0)]
    place(slam, poses, [0.25] * 4)
    slam.update(scan_of((1.5, 0.0)))
    slam.resample()
    estimate = slam.estimate()
    assert estimate.resampled
    np.testing.assert_array_equal(estimate.weights, [0, 1, 0, 0])
    np.testing.assert_array_equal(estimate.particles, poses)
    np.testing.assert_array_equal(estimate.parents, [0, 1, 2, 3])
    slam.predict(np.array([1.0, 0.0, 0.0]), 0.025)
    slam.update(scan_of())
    slam.resample()
    estimate = slam.estimate()
    np.testing.assert_array_equal(estimate.parents, [1, 1, 1, 1])
    np.testing.assert_allclose(estimate.particles, np.tile([1.25, 0.25, 0], (4, 1)))
    np.testing.assert_array_equal(estimate.weights, [0.25] * 4)
    assert not estimate.resampled


def test_the_trajectory_is_the_best_particle_at_every_scan() -> None:
    slam = ParticleFilter(config())
    for k in range(3):
        if k:
            slam.predict(np.array([0.5, 0.0, math.pi / 2]), 0.025)
        slam.update(scan_of())
        slam.resample()
    np.testing.assert_allclose(
        slam.trajectory(), [[0.0, 0, 0], [0.5, 0, math.pi / 2], [0.5, 0.5, -math.pi]], atol=1e-12
    )
