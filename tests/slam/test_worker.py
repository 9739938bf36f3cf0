"""The second thread: it works in order, hands on failures, and can be closed and used again."""

import threading

import pytest

from pfslam_viz.slam.worker import Worker, cores


def test_tasks_run_in_order_on_one_other_thread() -> None:
    worker, done = Worker(), []
    for k in range(5):
        worker.submit(lambda k: done.append((k, threading.current_thread().name)), k)
    worker.close()
    assert [k for k, _ in done] == [0, 1, 2, 3, 4]
    assert len({name for _, name in done}) == 1
    assert done[0][1] != threading.current_thread().name


def test_a_failure_comes_out_at_the_result() -> None:
    worker = Worker()
    with pytest.raises(ZeroDivisionError):
        worker.submit(lambda: 1 / 0).result()
    worker.close()


def test_close_ends_the_thread_and_may_be_repeated() -> None:
    before, worker = threading.active_count(), Worker()
    assert threading.active_count() == before  # nothing runs until there is something to do
    worker.submit(int).result()
    assert threading.active_count() == before + 1
    worker.close()
    worker.close()
    assert threading.active_count() == before
    assert worker.submit(lambda: 7).result() == 7
    worker.close()


def test_cores() -> None:
    assert cores() >= 1
