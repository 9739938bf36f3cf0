"""Angles by the increment; each expected angle is counted off by hand."""

import math

import numpy as np
import pytest

from pfslam_viz.recordings.beam_angles import beam_angles, increment_of


def test_limits_and_increment_that_agree() -> None:
    notes: list[str] = []
    np.testing.assert_allclose(beam_angles(5, (-1.0, 1.0), 0.5, notes), [-1, -0.5, 0, 0.5, 1], atol=1e-12)
    assert notes == []


@pytest.mark.parametrize("increment", [math.pi / 2, 1.5708])
def test_a_lidar_all_round_whose_limit_is_a_whole_turn(increment: float) -> None:
    """Four beams a quarter turn apart: the last looks to the right, though angle_max is that of the first again."""
    notes: list[str] = []
    angles = beam_angles(4, (0.0, 2 * math.pi), increment, notes)
    np.testing.assert_allclose(angles, [0, math.pi / 2, math.pi, 1.5 * math.pi], atol=2e-5)
    assert len(notes) == 1 and "would make 5 beams; ranges has 4" in notes[0]


def test_any_other_angle_max() -> None:
    notes: list[str] = []
    np.testing.assert_allclose(beam_angles(3, (-0.2, 3.0), 0.1, notes), [-0.2, -0.1, 0.0], atol=1e-12)
    assert "taken at 0 rad" in notes[0]
    np.testing.assert_allclose(beam_angles(3, (0.0, 0.0), 0.1, notes), [0.0, 0.1, 0.2], atol=1e-12)


def test_clockwise() -> None:
    np.testing.assert_allclose(beam_angles(3, (1.0, -1.0), -1.0, []), [1.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(beam_angles(4, (0.0, -2 * math.pi), -math.pi / 2, [])[3], -1.5 * math.pi, atol=1e-12)
    notes: list[str] = []
    np.testing.assert_allclose(beam_angles(3, (1.0, -1.0), 1.0, notes), [1.0, 0.0, -1.0], atol=1e-12)
    assert "in the limits' direction" in notes[0]


@pytest.mark.parametrize("increment", [None, 0.0, 90.0])
def test_without_a_usable_increment_the_limits_count(increment: float | None) -> None:
    notes: list[str] = []
    np.testing.assert_allclose(beam_angles(3, (-1.0, 1.0), increment, notes), [-1, 0, 1], atol=1e-12)
    assert len(notes) == (increment is not None)
    assert beam_angles(1, (0.3, 0.9), 0.1, []).tolist() == [0.3]


def test_an_increment_that_is_no_number() -> None:
    assert increment_of({}) is None
    assert increment_of({"angle_increment": np.array([[0.5]])}) == 0.5
    for value in (np.array([np.nan]), np.array([0.1, 0.2]), np.array(["a"])):
        assert increment_of({"angle_increment": value}) is None
