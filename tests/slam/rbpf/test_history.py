"""The particles' ancestry against a list of whole trajectories per particle, copied at every resampling."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.rbpf.history import History

Array = NDArray[np.float64]

N = 6


def pose(*values: float) -> Array:
    return np.array(values, np.float64)


def keyed(history: History, poses: Array) -> None:
    """A key scan without odometry."""
    history.add_key(poses, np.zeros(3), np.zeros(3))
    history.add_scan(np.zeros(3))


def test_key_poses_are_those_of_the_ancestors_by_hand() -> None:
    """Three particles; after the first key scan all descend from 2, after the second they become 1, 0, 0."""
    history = History(3)
    keyed(history, np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]))
    history.resample(np.array([2, 2, 2]))
    keyed(history, np.array([[10.0, 0, 0], [11, 0, 0], [12, 0, 0]]))
    history.resample(np.array([1, 0, 0]))
    keyed(history, np.array([[20.0, 0, 0], [21, 0, 0], [22, 0, 0]]))
    np.testing.assert_array_equal(history.key_poses(0)[:, 0], [2, 11, 20])
    np.testing.assert_array_equal(history.key_poses(1)[:, 0], [2, 10, 21])
    np.testing.assert_array_equal(history.key_poses(2)[:, 0], [2, 10, 22])
    assert len(history) == 3 and history.keys == [0, 1, 2]


def test_key_poses_equal_lists_that_are_copied() -> None:
    """Sixty scans, some of them keys, some followed by resampling, some by two of it."""
    rng = np.random.default_rng(0)
    history = History(N)
    trajectories: list[list[Array]] = [[] for _ in range(N)]
    lineages: list[list[int]] = [[] for _ in range(N)]
    resampled = 0
    for scan in range(60):
        if scan == 0 or rng.random() < 0.5:
            poses = rng.normal(size=(N, 3))
            history.add_key(poses, np.zeros(3), np.zeros(3))
            for p in range(N):
                trajectories[p].append(poses[p].copy())
                lineages[p].append(p)
            poses[:] = np.nan  # the history has copies of its own
        history.add_scan(np.zeros(3))
        for _ in range(int(rng.integers(0, 3))):
            drawn = rng.integers(0, N, N) if rng.random() < 0.3 else np.arange(N)
            history.resample(drawn)
            trajectories = [list(trajectories[d]) for d in drawn]
            lineages = [list(lineages[d]) for d in drawn]
            resampled += 1
        for p in range(N):
            np.testing.assert_array_equal(history.key_poses(p), trajectories[p])
    assert resampled > 20 and len(history) > 20
    assert len(np.unique([line[0] for line in lineages])) == 1  # there was something to inherit


def test_the_odometry_between_key_scans_is_kept() -> None:
    history = History(2)
    assert history.odometry().shape == (0, 3)
    history.add_key(np.zeros((2, 3)), np.zeros(3), np.zeros(3))
    history.add_scan(np.zeros(3))
    history.add_scan(pose(0.1, 0, 0))
    history.add_key(np.ones((2, 3)), pose(0.3, 0.01, 0.02), pose(0.4, 0, 0))
    np.testing.assert_array_equal(history.odometry(), [[0, 0, 0], [0.3, 0.01, 0.02]])


def test_what_the_odometry_did_not_know_is_kept() -> None:
    """A column, to be multiplied by errors per s; nothing unknown unless it is said."""
    history = History(2)
    for unknown in (0.0, 0.3, 0.05):
        history.add_key(np.zeros((2, 3)), np.zeros(3), np.zeros(3), unknown)
        history.add_scan(np.zeros(3))
    keyed(history, np.zeros((2, 3)))
    np.testing.assert_array_equal(history.unknown(), [[0.0], [0.3], [0.05], [0.0]])


def straight(missed: Array) -> tuple[History, Array]:
    """Keys at scans 0 and 4, matching saw 1 m ahead between them; the key poses are off by ``missed`` from that."""
    history = History(1)
    start = pose(2.0, 1.0, np.pi / 2)
    history.add_key(start[None], np.zeros(3), np.zeros(3))
    history.add_scan(np.zeros(3))
    for offset in (0.2, 0.5, 0.9):
        history.add_scan(pose(offset, 0.0, 0.0))
    end = geometry.compose(start, geometry.compose(pose(1.0, 0, 0), missed))
    history.add_key(end[None], np.zeros(3), pose(1.0, 0, 0))
    history.add_scan(np.zeros(3))
    history.add_scan(pose(0.25, 0.0, 0.1))
    return history, history.key_poses(0)


def test_a_trajectory_goes_through_the_key_poses_and_keeps_its_shape() -> None:
    """Facing +y from (2, 1) nothing is missed: every scan lies where matching put it, the last beyond the key."""
    history, keys = straight(np.zeros(3))
    assert history.keys == [0, 4]
    expected = [[2, 1.0, 0], [2, 1.2, 0], [2, 1.5, 0], [2, 1.9, 0], [2, 2.0, 0], [2, 2.25, 0.1]]
    np.testing.assert_allclose(history.trajectory(keys) - [0, 0, np.pi / 2], expected, atol=1e-12)


def test_what_is_missed_is_spread_evenly_over_the_scans() -> None:
    """4 cm too short and 8 cm too far left at the second key: 0, 1, 2 and 3 quarters of it on the scans between."""
    history, keys = straight(pose(-0.04, 0.08, 0.0))
    expected = [[2, 1.0], [1.98, 1.19], [1.96, 1.48], [1.94, 1.87], [1.92, 1.96], [1.92, 2.21]]
    np.testing.assert_allclose(history.trajectory(keys)[:, :2], expected, atol=1e-12)


def test_a_missed_heading_is_spread_evenly() -> None:
    history, keys = straight(pose(0.0, 0.0, -0.2))
    headings = geometry.wrap(history.trajectory(keys)[:, 2] - np.pi / 2)
    np.testing.assert_allclose(headings, [0, -0.05, -0.1, -0.15, -0.2, -0.1], atol=1e-12)


def test_any_key_poses_are_hit_exactly() -> None:
    """Random offsets and key poses, keys on successive scans and far apart: a pose a scan, keys where they are."""
    rng = np.random.default_rng(2)
    history = History(1)
    is_key = rng.random(50) < 0.4
    is_key[0] = True
    for key in is_key:
        if key:
            history.add_key(rng.normal(size=(1, 3)), np.zeros(3), rng.normal(size=3))
        history.add_scan(np.zeros(3) if key else rng.normal(size=3))
    assert (np.diff(history.keys) == 1).any() and (np.diff(history.keys) > 2).any()
    wanted = rng.normal(size=(len(history), 3))
    out = history.trajectory(wanted)
    assert out.shape == (50, 3)
    np.testing.assert_allclose(out[is_key], wanted, atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(is_key), history.keys)


def test_nothing_yet_and_a_single_scan() -> None:
    history = History(2)
    assert history.trajectory(np.zeros((0, 3))).shape == (0, 3)
    keyed(history, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 0.0]]))
    np.testing.assert_allclose(history.trajectory(history.key_poses(1)), [[4, 5, 0]])
