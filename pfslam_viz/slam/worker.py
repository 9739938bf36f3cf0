"""A second thread beside the filter's: kernels release the interpreter's lock, so that two cores can work.

Every element's result depends on that element alone, so the results do not depend on the threads.
"""

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Generic, TypeVar

T = TypeVar("T")


def cores() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Worker:
    """One thread that helps the caller's. It starts with the first task and ends with :meth:`close`."""

    def __init__(self, threads: int = 2) -> None:
        """With fewer than 2 ``threads`` there is no other one: everything is done on the caller's."""
        self._alone = threads < 2
        self._pool: ThreadPoolExecutor | None = None
        self._deferred: list[Deferred[Any]] = []

    def split(self, work: Callable[[slice], T], count: int, *, worth: int, pieces: int = 2) -> list[T]:
        """``work`` on ``count`` elements in ``pieces``, answered in order; whoever is free takes the next one.

        This thread takes them from the front, the other one from the back. Fewer than ``worth`` elements are done at
        once, here: waking the other thread takes about 0.1 ms.
        """
        if self._alone or count < worth:
            return [work(slice(0, count))]
        bounds = [k * count // pieces for k in range(pieces + 1)]
        results: dict[int, T] = {}
        left = deque(range(pieces))

        def take(next_piece: Callable[[], int]) -> None:
            while True:
                try:
                    k = next_piece()
                except IndexError:
                    return
                results[k] = work(slice(bounds[k], bounds[k + 1]))

        other = self._submit(take, left.pop)
        for task in self._deferred:
            task.future = self._submit(task.run)
        self._deferred = []
        take(left.popleft)
        if not other.cancel():  # it may not even have started
            other.result()
        return [results[k] for k in range(pieces)]

    def defer(self, run: Callable[[], T]) -> "Deferred[T]":
        """Have ``run`` done behind the next :meth:`split`'s part on the other thread, which is awake then.

        It is done here when its result is asked for before.
        """
        task = Deferred(run)
        self._deferred.append(task)
        return task

    def result(self, task: "Deferred[T]") -> T:
        """What the deferred task returns."""
        if task.future is not None and not task.future.cancel():
            return task.future.result()
        self._deferred = [other for other in self._deferred if other is not task]
        return task.run()

    def _submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        if self._pool is None:
            self._pool = ThreadPoolExecutor(1, "pfslam")
        return self._pool.submit(task, *arguments)

    def close(self) -> None:
        """Finish what is queued and end the thread; a closed worker starts again when it is needed."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None


class Deferred(Generic[T]):
    """A task for the time that the other thread has left."""

    def __init__(self, run: Callable[[], T]) -> None:
        self.run = run
        self.future: Future[T] | None = None
