"""Halves of an array on two threads."""

import threading

import numpy as np
import pytest

from pfslam_viz.slam.threads import in_halves


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7, 8, 100])
@pytest.mark.parametrize("worth", [0, 4, 1000])
def test_every_element_is_worked_on_once_and_in_order(count: int, worth: int) -> None:
    values = np.arange(count) ** 2
    parts = in_halves(lambda part: values[part].copy(), count, worth=worth)
    np.testing.assert_array_equal(np.concatenate(parts), values)
    assert len(parts) == (1 if count < worth else 2)


def test_the_halves_are_worked_on_at_the_same_time() -> None:
    """Each half waits for the other one: one thread alone would wait for ever."""
    together = threading.Barrier(2, timeout=20)
    names = in_halves(lambda part: (together.wait(), threading.current_thread().name)[1], 10, worth=2)
    assert names[0] == threading.current_thread().name != names[1]


def test_too_few_stay_on_this_thread() -> None:
    names = in_halves(lambda part: threading.current_thread().name, 3, worth=4)
    assert names == [threading.current_thread().name]


@pytest.mark.parametrize("failing", [0, 5])
def test_an_error_in_either_half_comes_out(failing: int) -> None:
    def work(part: slice) -> int:
        if part.start == failing:
            raise ValueError("no")
        return 1

    with pytest.raises(ValueError, match="no"):
        in_halves(work, 10, worth=2)
    assert in_halves(lambda part: 1, 10, worth=2) == [1, 1]  # and the other thread still works
