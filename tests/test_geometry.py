"""SE(2) against numbers worked by hand, and the matrices it stands for."""

import math

import numpy as np
import pytest

from pfslam_viz import geometry

QUARTER = math.pi / 2


def matrix(pose: np.ndarray) -> np.ndarray:
    """The homogeneous matrix of a pose: an independent way to compose."""
    x, y, a = pose
    return np.array([[math.cos(a), -math.sin(a), x], [math.sin(a), math.cos(a), y], [0, 0, 1]])


def random_poses(n: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-5, -5, -math.pi], [5, 5, math.pi], (n, 3))


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0.0, 0.0), (3 * QUARTER, -QUARTER), (-3 * QUARTER, QUARTER), (math.pi, -math.pi), (7.0, 7.0 - 2 * math.pi)],
)
def test_wrap(angle: float, wrapped: float) -> None:
    assert geometry.wrap(angle) == pytest.approx(wrapped)


def test_compose_by_hand() -> None:
    # Facing +y at (1, 2): one metre ahead is +y, one to the left is -x.
    assert geometry.compose([1, 2, QUARTER], [1, 0, 0]) == pytest.approx([1, 3, QUARTER])
    assert geometry.compose([1, 2, QUARTER], [0, 1, 0]) == pytest.approx([0, 2, QUARTER])
    assert geometry.compose([0, 0, 3.0], [0, 0, 1.0])[2] == pytest.approx(4.0 - 2 * math.pi)


def test_compose_is_the_matrix_product() -> None:
    a, b = random_poses(20, 1), random_poses(20, 2)
    for left, right, both in zip(a, b, geometry.compose(a, b), strict=True):
        np.testing.assert_allclose(matrix(both), matrix(left) @ matrix(right), atol=1e-12)


def test_compose_broadcasts_one_increment_over_many_poses() -> None:
    poses = random_poses(7)
    np.testing.assert_allclose(geometry.compose(poses, [0.3, 0.1, 0.2])[4], geometry.compose(poses[4], [0.3, 0.1, 0.2]))


def test_single_poses_are_worked_out_as_many_are() -> None:
    """Far and near, over the seam of the heading, at rest, and without a number."""
    rng = np.random.default_rng(8)
    a, b = rng.normal(0.0, 20.0, (500, 3)), rng.normal(0.0, 20.0, (500, 3))
    a[::7, 2], b[::5] = np.pi, 0.0
    b[::9, 2], a[::11], a[3, 0], b[4, 1] = -np.pi, b[::11], np.nan, np.inf
    for of in (geometry.compose, geometry.between):
        one_by_one = np.array([of(start, end) for start, end in zip(a, b, strict=True)])
        np.testing.assert_array_equal(one_by_one, of(a, b))


def test_between_undoes_compose_and_inverse_is_its_own() -> None:
    a, b = random_poses(20, 3), random_poses(20, 4)
    np.testing.assert_allclose(geometry.compose(a, geometry.between(a, b)), b, atol=1e-12)
    np.testing.assert_allclose(geometry.compose(a, geometry.inverse(a)), np.zeros((20, 3)), atol=1e-12)
    assert geometry.between([1, 2, QUARTER], [1, 5, math.pi]) == pytest.approx([3, 0, QUARTER])


def test_transform_by_hand() -> None:
    points = geometry.transform([10, 20, QUARTER], [[1, 0], [0, 1], [2, 3]])
    np.testing.assert_allclose(points, [[10, 21], [9, 20], [7, 22]], atol=1e-12)
    assert geometry.transform([0, 0, 0], np.zeros((0, 2))).shape == (0, 2)


def test_accumulate_drives_a_square_back_to_its_start() -> None:
    side = [[2.0, 0.0, QUARTER]] * 4
    expected = [[2.0, 0.0, QUARTER], [2.0, 2.0, -math.pi], [0.0, 2.0, -QUARTER], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(geometry.accumulate(side), expected, atol=1e-12)


def test_accumulate_is_compose_one_by_one() -> None:
    steps, pose = random_poses(50, 5), np.array([1.0, -2.0, 0.7])
    for step, fast in zip(steps, geometry.accumulate(steps, pose), strict=True):
        pose = geometry.compose(pose, step)
        np.testing.assert_allclose(fast[:2], pose[:2], atol=1e-9)
        assert math.cos(fast[2] - pose[2]) == pytest.approx(1)
    assert geometry.accumulate(np.zeros((0, 3))).shape == (0, 3)


def test_mean_pose_takes_the_short_way_round() -> None:
    mean = geometry.mean_pose([[0, 0, 3.1], [4, 2, -3.1]], [3, 1])
    assert mean[:2] == pytest.approx([1.0, 0.5])
    # Weighted circular mean of 3.1 and 2 pi - 3.1 lies between 3.1 and pi, not near 0.
    assert 3.1 < mean[2] < math.pi


def test_increments_by_hand_and_back() -> None:
    poses = np.array([[5.0, 5.0, math.pi / 2], [5.0, 7.0, math.pi], [4.0, 7.0, -math.pi / 2]])
    steps = geometry.increments(poses)
    np.testing.assert_allclose(steps, [[0.0, 0.0, 0.0], [2.0, 0.0, math.pi / 2], [1.0, 0.0, math.pi / 2]], atol=1e-12)
    np.testing.assert_allclose(geometry.accumulate(steps, poses[0])[:, :2], poses[:, :2], atol=1e-12)
    assert geometry.increments(np.zeros((0, 3))).shape == (0, 3)


def test_path_length() -> None:
    assert geometry.path_length([[0, 0, 0], [3, 4, 1], [3, 5, 2]]) == pytest.approx(6)
    assert geometry.path_length([[1, 1, 0]]) == 0
    assert geometry.path_length(np.zeros((0, 3))) == 0


def test_interpolate_poses_holds_the_ends_and_crosses_the_seam() -> None:
    poses = [[0, 0, math.pi - 0.1], [2, 4, -math.pi + 0.1]]
    at = geometry.interpolate_poses([10, 20], poses, [5, 15, 25, 12.5])
    np.testing.assert_allclose(at[0], poses[0])
    np.testing.assert_allclose(at[1, :2], [1, 2])
    assert abs(at[1, 2]) == pytest.approx(math.pi)
    np.testing.assert_allclose(at[2], poses[1])
    np.testing.assert_allclose(at[3], [0.5, 1, math.pi - 0.05])


def test_a_steady_motion_by_hand() -> None:
    # A quarter turn to the left over an arc of 1 m radius ends 1 m ahead and 1 m to the left.
    assert geometry.steady_motion([QUARTER, 0.0, QUARTER]) == pytest.approx([1, 1, QUARTER])
    assert geometry.twist([1.0, 1.0, QUARTER]) == pytest.approx([QUARTER, 0, QUARTER])
    assert geometry.twist([2.0, -1.0, 0.0]) == pytest.approx([2, -1, 0])
    # Half the time leads to half the heading, 45 degrees along the same circle.
    half = geometry.steady_motion(0.5 * geometry.twist([1.0, 1.0, QUARTER]))
    assert half == pytest.approx([math.sin(math.pi / 4), 1 - math.cos(math.pi / 4), math.pi / 4])


def test_twist_and_steady_motion_are_each_others_reverse() -> None:
    steps = random_poses(50) * [1, 1, 0.9]
    np.testing.assert_allclose(geometry.steady_motion(geometry.twist(steps)), steps, atol=1e-12)
    # Two halves one after the other are the whole.
    half = geometry.steady_motion(0.5 * geometry.twist(steps))
    np.testing.assert_allclose(geometry.compose(half, half), steps, atol=1e-12)
