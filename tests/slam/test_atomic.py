import threading

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz.slam.atomic import fetch_add


@njit(nogil=True)
def count(array: NDArray[np.int64], index: int, times: int) -> int:
    """The sum of what was found."""
    found = 0
    for _ in range(times):
        found += fetch_add(array, index, 1)
    return found


def test_it_returns_what_was_there() -> None:
    array = np.array([5, 7, 9])
    assert count(array, 1, 3) == 7 + 8 + 9
    assert array.tolist() == [5, 10, 9]


def test_no_count_is_lost_between_threads() -> None:
    array, times = np.zeros(2, np.int64), 300_000
    found: list[int] = []
    count(array, 0, 0)
    threads = [threading.Thread(target=lambda: found.append(count(array, 0, times))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert array.tolist() == [2 * times, 0]
    assert sum(found) == times * (2 * times - 1)  # each value was found once
