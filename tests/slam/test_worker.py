"""The second thread: it does its part in order, hands on failures, and can be closed and used again."""

import threading
import time
import weakref
from functools import partial

import numpy as np
import pytest

from pfslam_viz.slam.worker import Worker, cores


@pytest.fixture(params=[1, 2])
def worker(request: pytest.FixtureRequest):  # type: ignore[no-untyped-def]
    worker = Worker(request.param)
    yield worker
    worker.close()


def here() -> str:
    return threading.current_thread().name


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7, 8, 100])
@pytest.mark.parametrize("worth", [0, 4, 1000])
@pytest.mark.parametrize("pieces", [2, 5])
def test_every_element_is_worked_on_once_and_in_order(worker: Worker, count: int, worth: int, pieces: int) -> None:
    values = np.arange(count) ** 2
    parts = worker.split(lambda part: values[part].copy(), count, worth=worth, pieces=pieces)
    np.testing.assert_array_equal(np.concatenate(parts), values)


def test_the_parts_are_worked_on_at_the_same_time() -> None:
    """Each part waits for the other one: one thread alone would wait for ever."""
    worker, together = Worker(), threading.Barrier(2, timeout=20)
    names = worker.split(lambda part: (together.wait(), here(), part)[1:], 10, worth=2)
    worker.close()
    assert [part for _, part in names] == [slice(0, 5), slice(5, 10)]
    assert names[0][0] == here() != names[1][0]


def test_who_is_free_takes_the_next_piece() -> None:
    """While this thread is stuck in the first piece, the other one does all the others."""
    worker, begun, done = Worker(), threading.Barrier(2, timeout=20), []

    def work(part: slice) -> str:
        if part.start in (0, 8):
            begun.wait()
        if part.start > 0:
            done.append(part.start)
        while part.start == 0 and len(done) < 4:
            time.sleep(0.001)
        return here()

    names = worker.split(work, 10, worth=2, pieces=5)
    worker.close()
    assert names[0] == here() and here() not in names[1:]
    assert done == [8, 6, 4, 2]


def test_too_few_stay_on_this_thread_and_so_does_everything_with_one() -> None:
    before = threading.active_count()
    assert Worker().split(lambda part: here(), 3, worth=4) == [here()]
    assert Worker(1).split(lambda part: here(), 300, worth=4) == [here()]
    assert threading.active_count() == before  # nothing runs until there is something to do


@pytest.mark.parametrize("failing", [0, 5])
@pytest.mark.parametrize("error", [ValueError, IndexError])
def test_an_error_in_either_part_comes_out(failing: int, error: type[Exception]) -> None:
    def work(part: slice) -> int:
        if part.start == failing:
            raise error("no")
        return 1

    worker = Worker()
    with pytest.raises(error, match="no"):
        worker.split(work, 10, worth=2)
    assert worker.split(lambda part: 1, 10, worth=2) == [1, 1]  # and the other thread still works
    worker.close()


def test_a_task_is_done_by_the_other_thread_in_the_order_given() -> None:
    worker, begun = Worker(), threading.Event()
    order: list[str] = []

    def work() -> str:
        begun.set()
        order.append("first")
        return here()

    first = worker.submit(work)
    assert begun.wait(20)  # without a result being asked for
    second, third = (worker.submit(partial(order.append, name)) for name in ("second", "third"))
    assert first.result() != here()
    worker.close()  # finishes what is queued
    assert order == ["first", "second", "third"]
    assert second.result() is third.result() is None
    assert order == ["first", "second", "third"]  # each once


def test_a_task_that_has_not_begun_is_done_where_its_result_is_asked_for() -> None:
    worker, release = Worker(), threading.Event()
    busy = worker.submit(lambda: release.wait(20))
    assert worker.submit(here).result() == here()
    release.set()
    assert busy.result()
    worker.close()
    alone = Worker(1).submit(here)
    assert alone.result() == alone.result() == here()


def test_a_task_that_has_begun_is_waited_for() -> None:
    worker, begun, release = Worker(), threading.Event(), threading.Event()

    def work() -> int:
        begun.set()
        release.wait(20)
        return 7

    task = worker.submit(work)
    begun.wait(20)
    threading.Timer(0.05, release.set).start()
    assert task.result() == 7
    worker.close()


def test_a_task_hands_on_its_failure(worker: Worker) -> None:
    task = worker.submit(lambda: 1 / 0)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            task.result()
    assert worker.submit(lambda: 3).result() == 3  # and the other thread still works


def test_close_ends_the_thread_and_may_be_repeated() -> None:
    before, worker = threading.active_count(), Worker()
    for _ in range(2):
        worker.split(lambda part: None, 10, worth=2)
        assert threading.active_count() == before + 1
        worker.close()
        worker.close()
        assert threading.active_count() == before


def test_cores() -> None:
    assert cores() >= 1


def test_work_that_is_done_keeps_nothing_alive(worker: Worker) -> None:
    class Large:
        def use(self) -> int:
            return 3

    large = Large()
    alive = weakref.ref(large)
    task = worker.submit(large.use)
    del large
    assert task.result() == 3
    for _ in range(200):  # the other thread may still be on its way out
        if alive() is None:
            break
        time.sleep(0.01)
    assert alive() is None
    assert task.result() == 3
