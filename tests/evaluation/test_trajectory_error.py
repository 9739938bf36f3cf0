"""Error against truth, worked by hand."""

import math

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.evaluation.trajectory_error import pose_errors, trajectory_error


def test_numbers_by_hand() -> None:
    truth = np.array([[0, 0, 0], [1, 0, 0], [2, 0, math.radians(179)]])
    estimate = np.array([[0, 0, 0], [1, 0.3, math.radians(2)], [2.4, 0, math.radians(-179)]])
    error = trajectory_error(truth, estimate)
    assert error.position_rmse == pytest.approx(math.sqrt((0.09 + 0.16) / 3))
    assert error.position_max == pytest.approx(0.4)
    assert error.position_final == pytest.approx(0.4)
    assert error.heading_rmse == pytest.approx(math.sqrt((4 + 4) / 3))  # -179 is 2 past 179, the short way round
    assert error.heading_max == pytest.approx(2.0)


def test_is_aligned_by_the_first_pose_alone() -> None:
    rng = np.random.default_rng(1)
    path = geometry.accumulate(rng.normal([0.1, 0, 0], [0.02, 0.02, 0.1], (200, 3)))
    moved = geometry.compose([5.0, -3.0, 2.0], path)
    position, heading = pose_errors(path, moved)
    assert np.abs(position).max() < 1e-9 and np.abs(heading).max() < 1e-9
    # A heading error at the start is a lever for all that follows: no best fit may hide it.
    straight = np.stack([np.linspace(0, 10, 11), np.zeros(11), np.zeros(11)], axis=-1)
    turned = straight.copy()
    turned[0, 2] = math.radians(1)
    position, heading = pose_errors(straight, turned)
    assert position[-1] == pytest.approx(2 * 10 * math.sin(math.radians(0.5)))
    assert heading[1:] == pytest.approx(np.full(10, -1.0))


def test_wants_pose_beside_pose() -> None:
    with pytest.raises(ValueError, match=r"\(3, 3\) and estimate \(2, 3\)"):
        trajectory_error(np.zeros((3, 3)), np.zeros((2, 3)))
