"""SE(2) as a group, whatever the poses: laws that hold for all of them, and motion against fine integration."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam import kernels

Array = NDArray[np.float64]

LENGTHS = st.floats(-1e3, 1e3)
ANGLES = st.floats(-20.0, 20.0)
SHORT_TURNS = st.floats(-3.0, 3.0)
POSES = st.tuples(LENGTHS, LENGTHS, ANGLES).map(np.array)
TWISTS = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), SHORT_TURNS).map(np.array)


def matrix(pose: Array) -> Array:
    """The homogeneous matrix (3, 3) of a pose."""
    x, y, a = pose
    return np.array([[math.cos(a), -math.sin(a), x], [math.sin(a), math.cos(a), y], [0, 0, 1]])


def alike(a: Array, b: Array, atol: float = 1e-8) -> None:
    """Two poses are the same place and direction."""
    np.testing.assert_allclose(matrix(a), matrix(b), atol=atol)


@given(ANGLES)
def test_a_wrapped_angle_points_the_same_way_and_is_in_range(angle: float) -> None:
    wrapped = float(geometry.wrap(angle))
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped - angle) > 1 - 1e-12


@given(POSES, POSES, POSES)
def test_poses_are_a_group(a: Array, b: Array, c: Array) -> None:
    compose, inverse, between = geometry.compose, geometry.inverse, geometry.between
    np.testing.assert_allclose(matrix(compose(a, b)), matrix(a) @ matrix(b), atol=1e-8)
    alike(compose(compose(a, b), c), compose(a, compose(b, c)))
    alike(compose(a, inverse(a)), np.zeros(3))
    alike(compose(inverse(a), a), np.zeros(3))
    alike(compose(a, between(a, b)), b)
    alike(between(compose(c, a), compose(c, b)), between(a, b), atol=1e-7)  # whatever frame they are given in
    alike(kernels.compose(a, b), compose(a, b))


@given(st.lists(POSES, min_size=1, max_size=20).map(np.array), POSES)
def test_accumulated_increments_are_the_poses_again(poses: Array, start: Array) -> None:
    steps = geometry.increments(poses)
    for there, back in zip(poses, geometry.accumulate(steps, poses[0]), strict=True):
        alike(there, back, atol=1e-7)
    moved = geometry.accumulate(steps, start)  # the same path from elsewhere
    np.testing.assert_allclose(geometry.path_length(moved), geometry.path_length(poses), atol=1e-6)


@given(POSES, st.lists(st.tuples(LENGTHS, LENGTHS), max_size=9).map(lambda p: np.array(p).reshape(-1, 2)))
def test_points_are_carried_by_the_matrix_and_keep_their_distances(pose: Array, points: Array) -> None:
    there = geometry.transform(pose, points)
    expected = (matrix(pose) @ np.column_stack([points, np.ones(len(points))]).T).T[:, :2]
    np.testing.assert_allclose(there, expected.reshape(-1, 2), atol=1e-8)
    np.testing.assert_allclose(kernels.transform(pose, points), there, atol=1e-8)
    np.testing.assert_allclose(geometry.transform(geometry.inverse(pose), there), points, atol=1e-7)


@given(TWISTS)
def test_a_steady_motion_is_its_fine_integration(twist: Array) -> None:
    """10,000 short straight steps, each turned by half of its turn first: the midpoint rule."""
    n = 10_000
    headings = (np.arange(n) + 0.5) * twist[2] / n
    c, s = np.cos(headings), np.sin(headings)
    expected = [(c * twist[0] - s * twist[1]).mean(), (s * twist[0] + c * twist[1]).mean(), twist[2]]
    increment = geometry.steady_motion(twist)
    np.testing.assert_allclose(increment, expected, atol=1e-6)
    np.testing.assert_allclose(geometry.twist(increment), twist, atol=1e-9)


@given(TWISTS, st.integers(1, 12))
def test_a_motion_in_parts_is_the_whole(twist: Array, parts: int) -> None:
    steps = np.tile(geometry.steady_motion(twist / parts), (parts, 1))
    alike(geometry.accumulate(steps)[-1], geometry.steady_motion(twist))


@given(st.lists(st.tuples(LENGTHS, LENGTHS, st.floats(-1.0, 1.0)), min_size=1, max_size=8).map(np.array), POSES)
def test_the_mean_of_poses_moves_with_them(poses: Array, frame: Array) -> None:
    weights = np.linspace(1.0, 2.0, len(poses))
    mean = geometry.mean_pose(poses, weights)
    assert poses[:, 2].min() - 1e-9 <= mean[2] <= poses[:, 2].max() + 1e-9
    alike(geometry.mean_pose(geometry.compose(frame, poses), weights), geometry.compose(frame, mean), atol=1e-7)
    kernel_mean, covariance, n_eff = kernels.moments(poses, weights / weights.sum())
    alike(kernel_mean, mean)
    assert 1.0 - 1e-9 <= n_eff <= len(poses) + 1e-9
    assert np.linalg.eigvalsh(covariance).min() > -1e-6 * max(1.0, float(np.abs(covariance).max()))
