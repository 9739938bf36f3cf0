"""Pairs of scans that are compared to tell how well an odometry explains them."""

import numpy as np

from pfslam_viz.recordings.checking.agreement import pairs_apart


def test_pairs_are_as_far_apart_as_asked() -> None:
    """Steps of 0.1 m: pairs 0.4 m apart are four scans apart."""
    odometry = np.tile([0.1, 0.0, 0.0], (60, 1))
    pairs = pairs_apart(odometry, distance=0.4)
    assert len(pairs) > 5
    np.testing.assert_array_equal(pairs.second - pairs.first, 4)


def test_steps_that_overflow_or_do_not_move_make_no_pairs() -> None:
    odometry = np.zeros((9, 3))
    assert len(pairs_apart(odometry)) == 0
    assert len(pairs_apart(odometry[:0])) == 0
    odometry[4, 0] = 1e308
    with np.errstate(over="ignore"):
        assert len(pairs_apart(odometry, distance=0.1)) == 0
