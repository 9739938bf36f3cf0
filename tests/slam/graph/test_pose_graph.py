"""Least squares over poses: derivatives by finite differences, chains worked by hand, loops with a known truth."""

import math

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph import pose_graph
from pfslam_viz.slam.graph.pose_graph import Constraints, optimize, residuals, turned, weights

Array = NDArray[np.float64]


def relaxed(poses: Array, constraints: Constraints, iterations: int = 10, scale: float = 5.0) -> Array:
    return optimize(poses, constraints, iterations=iterations, scale=scale, settled_distance=5e-4, settled_angle=1e-4)


def constraints(
    pairs: list[tuple[int, int]], measured: ArrayLike, information: Array | None = None, robust: ArrayLike = False
) -> Constraints:
    k = len(pairs)
    start, end = np.array(pairs, np.intp).reshape(-1, 2).T
    information = np.tile(np.eye(3), (k, 1, 1)) if information is None else information
    return Constraints(start, end, np.asarray(measured, np.float64), information, np.broadcast_to(robust, k).copy())


def square(side: float = 4.0, steps: int = 10) -> Array:
    """Poses (4 steps + 1, 3) once round a square, ending where they started."""
    increments = np.tile([side / steps, 0.0, 0.0], (4 * steps, 1))
    increments[steps - 1 :: steps, 2] = math.pi / 2
    return np.vstack([np.zeros(3), geometry.accumulate(increments)])


def chain(poses: Array) -> Constraints:
    """The true increments of successive poses, known to 1 cm, 1 cm and 0.01 rad."""
    pairs = [(k, k + 1) for k in range(len(poses) - 1)]
    information = np.tile(np.diag([1e4, 1e4, 1e4]), (len(pairs), 1, 1))
    return constraints(pairs, geometry.between(poses[:-1], poses[1:]), information)


def random_information(rng: np.random.Generator, k: int) -> Array:
    root = rng.standard_normal((k, 3, 3))
    return root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3)


def test_information_turns_into_the_poses_own_axes() -> None:
    """What is known along the reference's x is known along the own -y of a pose that has turned left by 90 degrees."""
    known = np.diag([9.0, 1.0, 4.0])
    known[0, 2] = known[2, 0] = 2.0  # x goes with the heading
    np.testing.assert_allclose(
        turned(known, math.pi / 2), [[1.0, 0.0, 0.0], [0.0, 9.0, -2.0], [0.0, -2.0, 4.0]], atol=1e-12
    )


def test_a_turned_error_weighs_the_same() -> None:
    """e' R' (information) R e with e in the pose's own axes, R e in the reference's; for many headings at once."""
    rng = np.random.default_rng(0)
    information, heading, error = random_information(rng, 20), rng.uniform(-3, 3, 20), rng.standard_normal((20, 3))
    own = turned(information, heading)
    for k in range(20):
        x, y, turn = error[k]
        c, s = math.cos(heading[k]), math.sin(heading[k])
        e = np.array([c * x - s * y, s * x + c * y, turn])
        assert error[k] @ own[k] @ error[k] == pytest.approx(e @ information[k] @ e)


def test_residuals_are_seen_from_the_measured_pose() -> None:
    """From (1, 2, 90°) a pose 2 m ahead facing left was measured, and it stands 2.5 m ahead, 0.1 rad too far left.

    The half metre ahead is half a metre to the right of a robot that faces left.
    """
    poses = np.array([[1.0, 2.0, math.pi / 2], [1.0, 4.5, -math.pi + 0.1]])
    c = constraints([(0, 1)], [[2.0, 0.0, math.pi / 2]])
    np.testing.assert_allclose(residuals(poses, c), [[0.0, -0.5, 0.1]], atol=1e-12)


def test_jacobians_equal_finite_differences() -> None:
    rng = np.random.default_rng(1)
    poses = rng.uniform(-3, 3, (12, 3))
    pairs = [(int(a), int(b)) for a, b in rng.integers(0, 12, (30, 2)) if a != b]
    measured = geometry.between(*(poses[list(side)] for side in zip(*pairs, strict=True)))
    measured = geometry.compose(measured, rng.normal(0, 0.3, measured.shape))  # no error near ±π
    c = constraints(pairs, measured)
    by_start, by_end = pose_graph._jacobians(poses, c)
    step = 1e-6
    for k, (start, end) in enumerate(pairs):
        for at, jacobian in ((start, by_start[k]), (end, by_end[k])):
            for axis in range(3):
                up, down = poses.copy(), poses.copy()
                up[at, axis] += step
                down[at, axis] -= step
                numeric = (residuals(up, c)[k] - residuals(down, c)[k]) / (2 * step)
                np.testing.assert_allclose(jacobian[:, axis], numeric, atol=1e-7)


def test_a_contradiction_is_shared_by_the_variances() -> None:
    """Two steps say 1 m each, the whole says 2.6 m. With variances 1, 4 and 1, of the 0.6 m they take 0.1, 0.4, 0.1."""
    information = np.array([np.diag([1.0, 1, 1]), np.diag([0.25, 1, 1]), np.diag([1.0, 1, 1])])
    c = constraints([(0, 1), (1, 2), (0, 2)], [[1.0, 0, 0], [1.0, 0, 0], [2.6, 0, 0]], information)
    poses = relaxed(np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]), c)
    np.testing.assert_allclose(poses, [[0.0, 0, 0], [1.1, 0, 0], [2.5, 0, 0]], atol=1e-6)


def test_information_off_the_diagonal_carries_over() -> None:
    """One constraint, whose optimum is itself, and a second that knows only x + y: minimising by hand.

    |p - (1, 0)|² + (x + y - 2)² has its minimum at p = (1, 0) + t (1, 1) with 2t + 2 (2t - 1) = 0, so t = 1/3.
    """
    both = np.array([[1.0, 1, 0], [1, 1, 0], [0, 0, 0]])
    c = constraints([(0, 1), (0, 1)], [[1.0, 0, 0], [1.0, 1.0, 0]], np.array([np.eye(3), both]))
    poses = relaxed(np.zeros((2, 3)), c)
    np.testing.assert_allclose(poses[1], [4 / 3, 1 / 3, 0], atol=1e-6)


def test_a_bent_loop_is_made_square_again() -> None:
    """Consistent constraints, a start far off: the truth is recovered to the optimiser's tolerance of 0.1 mm."""
    truth = square()
    rng = np.random.default_rng(2)
    bent = geometry.accumulate(geometry.between(truth[:-1], truth[1:]) + rng.normal(0, [0.02, 0.02, 0.02], (40, 3)))
    bent = np.vstack([np.zeros(3), bent])
    assert np.abs(bent - truth)[-1, :2].max() > 0.2
    closure = constraints([(0, 40)], [[0.0, 0, 0]], np.diag([1e4, 1e4, 1e4])[None])
    found = relaxed(bent, Constraints.join([chain(truth), closure]), iterations=20)
    np.testing.assert_allclose(found[:, :2], truth[:, :2], atol=1e-4)
    np.testing.assert_allclose(geometry.wrap(found[:, 2] - truth[:, 2]), 0, atol=1e-5)


def test_a_closed_loop_is_better_than_dead_reckoning() -> None:
    """Noisy odometry round a square of 16 m with one loop closure, 20 times: what is left is well below half."""
    rng = np.random.default_rng(3)
    truth = square()
    before, after = [], []
    for _ in range(20):
        steps = geometry.between(truth[:-1], truth[1:]) + rng.normal(0, [0.01, 0.01, 0.01], (40, 3))
        reckoned = np.vstack([np.zeros(3), geometry.accumulate(steps)])
        odometry = constraints([(k, k + 1) for k in range(40)], steps, np.tile(np.diag([1e4, 1e4, 1e4]), (40, 1, 1)))
        closure = constraints([(0, 40)], [[0.0, 0, 0]], np.diag([1e6, 1e6, 1e6])[None], robust=False)
        found = relaxed(reckoned, Constraints.join([odometry, closure]))
        before.append(np.hypot(*(reckoned - truth)[:, :2].T).mean())
        after.append(np.hypot(*(found - truth)[:, :2].T).mean())
        assert np.hypot(*(found[-1] - truth[-1])[:2]) < 0.02
    assert np.mean(after) < 0.5 * np.mean(before)


def test_the_first_pose_stays() -> None:
    truth = geometry.compose([3.0, -2.0, 2.0], square())
    moved = truth.copy()
    moved[1:] += [0.05, -0.03, 0.02]
    found = relaxed(moved, chain(truth), iterations=20)
    np.testing.assert_array_equal(found[0], truth[0])
    np.testing.assert_allclose(found[:, :2], truth[:, :2], atol=1e-4)
    np.testing.assert_allclose(geometry.wrap(found[:, 2] - truth[:, 2]), 0, atol=1e-5)


def test_weights_fall_with_the_distance_in_sigmas() -> None:
    """0, 5 and 10 sigmas at scale 5: 1, 1 / (1 + 1)², 1 / (1 + 4)²; who is not robust keeps 1."""
    poses = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    measured = np.array([[1.0, 0, 0], [1.5, 0, 0], [1.0, 1.0, 0], [1.0, 1.0, 0]])
    information = np.tile(np.diag([100.0, 100, 100]), (4, 1, 1))
    c = constraints([(0, 1)] * 4, measured, information, robust=[True, True, True, False])
    np.testing.assert_allclose(weights(poses, c, 5.0), [1.0, 0.25, 0.04, 1.0])
    np.testing.assert_allclose(weights(poses, c, 10.0), [1.0, 0.64, 0.25, 1.0])


def test_a_false_closure_is_rejected_if_it_is_robust() -> None:
    """Somebody claims that half way round the square the robot was back at the start, 5.7 m away."""
    truth = square()
    information = np.tile(np.diag([1e4, 1e4, 1e4]), (2, 1, 1))
    for robust in (True, False):
        closures = constraints([(0, 20), (0, 40)], [[0.0, 0, 0], [0.0, 0, 0]], information, robust=robust)
        found = relaxed(truth, Constraints.join([chain(truth), closures]), iterations=20)
        moved = np.hypot(*(found - truth)[:, :2].T).max()
        assert moved < 0.01 if robust else moved > 1.0


def test_a_true_closure_counts_though_it_is_robust() -> None:
    """Within its 5 sigmas a robust closure pulls: the end comes back by most of 5 cm."""
    truth = square()
    drifted = geometry.accumulate(geometry.between(truth[:-1], truth[1:]) * [1.003, 1, 1])
    drifted = np.vstack([np.zeros(3), drifted])
    drifted[:, 0] += np.linspace(0, 0.05, 41)
    closure = constraints([(0, 40)], [[0.0, 0, 0]], np.diag([1e6, 1e6, 1e6])[None], robust=True)
    steps = chain(drifted)
    found = relaxed(drifted, Constraints.join([steps, closure]), scale=50.0)
    assert np.hypot(*drifted[-1, :2]) == pytest.approx(0.05, abs=0.001)
    assert np.hypot(*found[-1, :2]) < 0.01


def test_nothing_to_do() -> None:
    alone = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(relaxed(alone, constraints([], np.zeros((0, 3)))), alone)
    two = np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 3.0]])
    np.testing.assert_array_equal(relaxed(two, constraints([], np.zeros((0, 3)))), two)
    given = square()
    kept = given.copy()
    relaxed(given + 0.0, chain(given))
    np.testing.assert_array_equal(given, kept)


def test_a_pose_without_constraints_stays() -> None:
    """Pose 2 is nobody's: the others are solved for without it."""
    poses = np.array([[0.0, 0, 0], [1.2, 0, 0], [7.0, 8.0, 1.0]])
    found = relaxed(poses, constraints([(0, 1)], [[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(found, [[0.0, 0, 0], [1.0, 0, 0], [7.0, 8.0, 1.0]], atol=1e-6)


def test_join_keeps_everything_in_order() -> None:
    a = constraints([(0, 1), (1, 2)], np.ones((2, 3)), robust=True)
    b = constraints([(2, 0)], np.full((1, 3), 2.0), 5 * np.eye(3)[None])
    both = Constraints.join([a, b])
    assert len(both) == 3
    np.testing.assert_array_equal(both.start, [0, 1, 2])
    np.testing.assert_array_equal(both.end, [1, 2, 0])
    np.testing.assert_array_equal(both.measured[:, 0], [1, 1, 2])
    np.testing.assert_array_equal(both.information[2], 5 * np.eye(3))
    np.testing.assert_array_equal(both.robust, [True, True, False])
