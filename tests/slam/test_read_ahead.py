"""Reading ahead, against reading one number after the other."""

from threading import Event, get_ident

import numpy as np
import pytest

from pfslam_viz.slam.read_ahead import BATCH, ReadAhead
from pfslam_viz.slam.worker import Worker


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("first", [0, 3])
@pytest.mark.parametrize("count", [0, 1, BATCH, 3 * BATCH + 1])
def test_all_come_in_order_each_once(threads: int, first: int, count: int) -> None:
    worker, read = Worker(threads), list[int]()

    def square(k: int) -> int:
        read.append(k)
        return k * k

    ahead = ReadAhead(square, first, first + count, worker)
    assert [ahead.take() for _ in range(count)] == [k * k for k in range(first, first + count)]
    worker.close()
    assert sorted(read) == list(range(first, first + count))
    with pytest.raises(IndexError):
        ahead.take()


def test_one_thread_reads_nothing_ahead_and_two_only_some() -> None:
    for threads, most in ((1, 1), (2, 2 * BATCH)):
        worker, read = Worker(threads), list[int]()
        ahead = ReadAhead(read.append, 0, 1000, worker)
        ahead.take()
        worker.close()
        assert 1 <= len(read) <= most and read[0] == 0


def test_the_other_thread_reads_beside() -> None:
    worker, readers, beside = Worker(2), dict[int, int](), Event()

    def read(k: int) -> None:
        readers[k] = get_ident()
        if k == 2 * BATCH - 1:
            beside.set()

    ahead = ReadAhead(read, 0, 10 * BATCH, worker)
    ahead.take()
    assert beside.wait(10.0)
    assert readers[2 * BATCH - 1] != get_ident()
    worker.close()


def test_what_cannot_be_read_is_told_when_it_is_asked_for() -> None:
    worker = Worker(2)
    ahead = ReadAhead(lambda k: np.arange(BATCH)[k], 0, 2 * BATCH, worker)
    assert [ahead.take() for _ in range(BATCH)] == list(range(BATCH))
    with pytest.raises(IndexError, match="out of bounds"):
        ahead.take()
    worker.close()
