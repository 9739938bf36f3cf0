"""What is left of the filter's own way when all particles are set on another one: by hand."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.rbpf.history import History

Array = NDArray[np.float64]

ZERO = np.zeros(3)


def add(history: History, *xs: float) -> None:
    """A key scan with the particles on the x axis."""
    history.add_key(np.column_stack([xs, np.zeros(len(xs)), np.zeros(len(xs))]), ZERO, ZERO)
    history.add_scan(ZERO)


def two_particles() -> History:
    """Particle 0 came by 0, 1, 3, particle 1 by 0.5, 2, 6; then both become 1, which is where the crossing shows."""
    history = History(2)
    add(history, 0.0, 0.5)
    add(history, 1.0, 2.0)
    add(history, 3.0, 6.0)
    return history


def test_increments_are_the_ancestors_in_their_own_frames() -> None:
    """Facing +y, 3 m along the world's x are 3 m to the right, and facing +x then is a quarter turn to the right."""
    history = two_particles()
    np.testing.assert_allclose(history.increments(0), [[1.0, 0, 0], [2.0, 0, 0]])
    np.testing.assert_allclose(history.increments(1), [[1.5, 0, 0], [4.0, 0, 0]])
    history.resample(np.array([1, 1]))
    np.testing.assert_allclose(history.increments(0), [[1.5, 0, 0], [4.0, 0, 0]])
    turned = History(1)
    turned.add_key(np.array([[1.0, 2.0, np.pi / 2]]), ZERO, ZERO)
    turned.add_key(np.array([[4.0, 2.0, 0.0]]), ZERO, ZERO)
    np.testing.assert_allclose(turned.increments(0), [[0.0, -3.0, -np.pi / 2]], atol=1e-12)
    assert History(3).increments(1).shape == (0, 3)


def test_after_a_rebase_all_came_the_same_way_and_stand_where_they_are_told() -> None:
    history = two_particles()
    history.resample(np.array([1, 0]))  # who carries on whom before does not matter any more
    revised = np.array([[0.0, 0, 0], [0.0, 5.0, 1.0], [0.0, 9.0, 2.0]])
    stand = np.array([[0.1, 9.0, 2.0], [-0.1, 9.0, 2.1]])
    history.rebase(0, revised, stand)
    for particle in range(2):
        np.testing.assert_array_equal(history.key_poses(particle)[:2], revised[:2])
        np.testing.assert_array_equal(history.key_poses(particle)[2], stand[particle])
    assert len(history) == 3 and history.keys == [0, 1, 2]


def test_what_the_filter_found_outlives_rebases() -> None:
    """Particle 1's way, 1.5 and 4 m, is kept, whatever poses are set; what comes after is measured from there."""
    history = two_particles()
    history.rebase(1, np.array([[0.0, 0, 0], [7.0, 0, 0], [8.0, 0, 0]]), np.array([[8.0, 0, 0], [8.5, 0, 0]]))
    kept = [[1.5, 0, 0], [4.0, 0, 0]]
    for particle in range(2):
        np.testing.assert_allclose(history.increments(particle), kept)
    add(history, 9.0, 9.25)  # 1 m on from 8, 0.75 m from 8.5
    np.testing.assert_allclose(history.increments(0), [*kept, [1.0, 0, 0]])
    np.testing.assert_allclose(history.increments(1), [*kept, [0.75, 0, 0]])
    history.resample(np.array([1, 1]))
    np.testing.assert_allclose(history.increments(0), [*kept, [0.75, 0, 0]])
    history.rebase(0, np.zeros((4, 3)), np.zeros((2, 3)))
    np.testing.assert_allclose(history.increments(1), [*kept, [0.75, 0, 0]])
    np.testing.assert_array_equal(history.key_poses(1), np.zeros((4, 3)))


def test_resampling_after_a_rebase_changes_who_stands_where() -> None:
    history = two_particles()
    history.rebase(0, np.zeros((3, 3)), np.array([[1.0, 0, 0], [2.0, 0, 0]]))
    history.resample(np.array([1, 0]))
    add(history, 5.0, 6.0)
    np.testing.assert_array_equal(history.key_poses(0)[:, 0], [0, 0, 2, 5])
    np.testing.assert_array_equal(history.key_poses(1)[:, 0], [0, 0, 1, 6])


def test_a_rebase_beyond_the_first_64_keys() -> None:
    """The arrays have grown by then, and 100 random steps come back as they were put in."""
    rng = np.random.default_rng(0)
    steps = rng.normal(0, 0.3, (100, 3))
    poses = geometry.accumulate(steps)
    history = History(1)
    for pose in poses:
        history.add_key(pose[None], ZERO, ZERO)
    history.rebase(0, np.zeros((100, 3)), np.zeros((1, 3)))
    np.testing.assert_allclose(history.increments(0), steps[1:], atol=1e-9)
    assert not history.key_poses(0).any()
