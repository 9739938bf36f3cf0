"""The motion model, (13), (18) and (19), against numbers worked by hand and statistics."""

import math

import numpy as np
import pytest

from pfslam_viz.slam.paper.motion import predict, scaled_variance
from pfslam_viz.slam.paper.settings import MotionConfig


def test_without_noise_every_particle_moves_in_its_own_frame() -> None:
    config = MotionConfig(variance=(0.0, 0.0, 0.0))
    particles = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, math.pi / 2], [0.0, 0.0, 3.0]])
    moved = predict(particles, np.array([0.5, 0.1, 0.2]), 0.025, config, np.random.default_rng(0))
    np.testing.assert_allclose(moved[0], [1.5, 2.1, 0.2])
    np.testing.assert_allclose(moved[1], [0.9, 2.5, math.pi / 2 + 0.2])
    assert moved[2, 2] == pytest.approx(3.2 - 2 * math.pi)  # headings stay in [-pi, pi)
    np.testing.assert_array_equal(particles[0], [1, 2, 0])


def test_additive_noise_has_the_configured_variance_even_at_rest() -> None:
    config = MotionConfig(variance=(0.001, 0.004, 0.009))
    moved = predict(np.zeros((20_000, 3)), np.zeros(3), 0.025, config, np.random.default_rng(1))
    np.testing.assert_allclose(moved.mean(axis=0), 0.0, atol=3 * 0.095 / math.sqrt(20_000))
    np.testing.assert_allclose(np.cov(moved.T), np.diag([0.001, 0.004, 0.009]), atol=4e-4)


def test_additive_noise_is_the_worlds_not_the_robots() -> None:
    config = MotionConfig(variance=(0.01, 0.0, 0.0))
    facing_up = np.tile([0.0, 0.0, math.pi / 2], (1000, 1))
    moved = predict(facing_up, np.array([1.0, 0.0, 0.0]), 0.025, config, np.random.default_rng(2))
    assert moved[:, 0].std() == pytest.approx(0.1, rel=0.1)
    np.testing.assert_allclose(moved[:, 1], 1.0)


SCALED = MotionConfig(
    model="scaled",
    distance_by_distance=0.1,
    distance_by_turn=0.2,
    turn_by_turn=0.3,
    turn_by_distance=0.05,
    turn_by_time=0.01,
)


def test_scaled_variance_by_hand() -> None:
    """4 m and -1 rad in 9 s: 0.01 * 4 + 0.04 * 1 = 0.08 m²; 0.09 * 1 + 0.0025 * 4 + 0.0001 * 9 = 0.1009 rad²."""
    np.testing.assert_allclose(scaled_variance(np.array([4.0, 0.0, -1.0]), 9.0, SCALED), [0.08, 0.08, 0.1009])
    np.testing.assert_allclose(scaled_variance(np.array([0.0, 4.0, 1.0]), 9.0, SCALED), [0.08, 0.08, 0.1009])
    np.testing.assert_array_equal(scaled_variance(np.zeros(3), 0.0, SCALED), 0.0)


def test_scaled_variance_does_not_depend_on_the_number_of_scans() -> None:
    whole = scaled_variance(np.array([2.0, 0.0, 0.5]), 4.0, SCALED)
    parts = 50 * scaled_variance(np.array([0.04, 0.0, 0.01]), 0.08, SCALED)
    np.testing.assert_allclose(parts, whole)


def test_scaled_noise_has_that_variance_in_the_particles_frame() -> None:
    config = MotionConfig(model="scaled", distance_by_distance=0.1, turn_by_distance=0.05, turn_by_time=0.0)
    facing_up = np.tile([0.0, 0.0, math.pi / 2], (20_000, 1))
    moved = predict(facing_up, np.array([1.0, 0.0, 0.0]), 0.1, config, np.random.default_rng(3))
    np.testing.assert_allclose(moved.mean(axis=0), [0, 1, math.pi / 2], atol=3e-3)
    np.testing.assert_allclose(np.cov(moved.T), np.diag([0.01, 0.01, 0.0025]), atol=4e-4)


def test_a_robot_at_rest_has_no_scaled_noise_but_the_gyros() -> None:
    moved = predict(np.zeros((5000, 3)), np.zeros(3), 1.0, SCALED, np.random.default_rng(4))
    assert not moved[:, :2].any()
    assert moved[:, 2].std() == pytest.approx(0.01, rel=0.05)
