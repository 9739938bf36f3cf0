"""Stretches of scans, by hand."""

import numpy as np

from pfslam_viz.recordings.checking.stretches import stretches, told


def test_stretches_at_both_ends_and_of_one_scan() -> None:
    starts, ends = stretches(np.array([1, 1, 0, 1, 0, 0, 1], bool))
    assert starts.tolist() == [0, 3, 6]
    assert ends.tolist() == [2, 4, 7]


def test_none() -> None:
    assert [len(part) for part in stretches(np.zeros(4, bool))] == [0, 0]


def test_the_longest_of_those_marked_is_told() -> None:
    which = np.array([True, False, True])
    words, scan = told(which, np.array([5, 100, 1234]), np.array([6.0, 90.0, 7.25]))
    assert words == "in 2 stretches; the longest lasts 7.2 s from scan 1,234 on"
    assert scan == 1234


def test_one_is_one_stretch() -> None:
    words, _ = told(np.array([True]), np.array([0]), np.array([5.0]))
    assert words == "in 1 stretch; the longest lasts 5.0 s from scan 0 on"
