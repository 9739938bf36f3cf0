"""How far key scans drift apart: against drawn trajectories, and by hand."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.drift import Drift, joint_deviations, match_deviation, spanned
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.settings import DriftConfig

Array = NDArray[np.float64]
NO_LINKS = np.zeros((0, 2), np.int64)
CONFIG = DriftConfig()
HOPS = (1, 2, 4, 8)


def constraints(start: list[int], end: list[int], measured: Array, information: float = 1.0) -> Constraints:
    n = len(start)
    return Constraints(
        np.array(start),
        np.array(end),
        measured,
        np.repeat(information * np.eye(3)[None], n, axis=0),
        np.ones(n, np.bool_),
    )


def test_deviations_are_those_of_drawn_trajectories() -> None:
    """4,000 drives round a bend whose joints err by 1 cm (each axis, with 0.014 m of distance) and half a degree."""
    rng = np.random.default_rng(0)
    steps = np.tile([0.3, 0.0, 0.03], (60, 1))
    poses = geometry.accumulate(np.vstack([np.zeros(3), steps]))
    drawn = steps + rng.normal(0.0, [0.01, 0.01, 0.01], (4000, 60, 3))
    ends = np.zeros((4000, 3))
    for k in range(20, 60):  # seen from pose 20
        ends = geometry.compose(ends, drawn[:, k])
    joints = np.tile([0.01 * np.sqrt(2.0), 0.01], (60, 1))
    position, heading = Drift(poses, joints, NO_LINKS, 100).before(60)
    spread = ends - ends.mean(axis=0)
    assert position[20] == pytest.approx(np.sqrt((spread[:, :2] ** 2).sum(axis=1).mean()), rel=0.05)
    assert heading[20] == pytest.approx(spread[:, 2].std(), rel=0.05)


def test_a_link_is_a_short_cut() -> None:
    """Ten steps of 1 m good to 0.1 m; 1 and 8 are held together: from 0 to 9 only two joints are left."""
    poses = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    joints = np.tile([0.1, 0.0], (9, 1))
    far, _ = Drift(poses, joints, NO_LINKS, 100).before(9)
    near, _ = Drift(poses, joints, np.array([[1, 8]]), 100).before(9)
    np.testing.assert_allclose(far, 0.1 * np.sqrt(9.0 - np.arange(9)))
    np.testing.assert_allclose(near[[0, 1, 3, 8]], 0.1 * np.sqrt([2.0, 1.0, 3.0, 1.0]))


def test_links_are_thinned_evenly() -> None:
    """Of four links, each of which leads from one pose to 9 but one, two are tried: the first and the third."""
    poses = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    joints = np.tile([0.1, 0.0], (9, 1))
    links = np.array([[0, 8], [2, 8], [4, 8], [6, 8]])
    position, _ = Drift(poses, joints, links, 2).before(9)
    np.testing.assert_allclose(position[[0, 2, 4, 6]], 0.1 * np.sqrt([1.0, 3.0, 1.0, 3.0]))


def test_joints_are_spanned_by_near_matches_only() -> None:
    matched = constraints([0, 3, 1], [2, 4, 30], np.zeros((3, 3)))
    assert spanned(matched, 6, 8).tolist() == [True, True, False, True, False]


def test_triangles_tell_how_precise_matches_are() -> None:
    """Matches over one and two hops, each 2 cm and 0.3 degrees off."""
    rng = np.random.default_rng(1)
    n = 400
    start = [*range(n - 1), *range(n - 2)]
    end = [*range(1, n), *range(2, n)]
    true = np.column_stack([0.2 * (np.array(end) - start), np.zeros(len(start)), np.zeros(len(start))])
    measured = true + rng.normal(0.0, [0.02, 0.02, 0.005], true.shape)
    np.testing.assert_allclose(
        match_deviation(constraints(start, end, measured), HOPS, CONFIG), [0.02, 0.005], rtol=0.15
    )
    few = constraints(start[:5], end[:5], measured[:5])
    assert (match_deviation(few, HOPS, CONFIG) == [0.01, 0.005]).all()


def test_joints_without_a_match_are_as_good_as_the_odometry() -> None:
    matched = constraints([0], [1], np.zeros((1, 3)))
    motion = constraints([0, 1], [1, 2], np.zeros((2, 3)), information=0.25)
    np.testing.assert_allclose(
        joint_deviations(matched, motion, 3, 8, np.array([0.02, 0.01])), [[0.02, 0.01], [2.0, 2.0]]
    )
