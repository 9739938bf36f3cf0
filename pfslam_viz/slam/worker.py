"""A second thread beside the filter's: kernels release the interpreter's lock, so that two cores can work.

Every element's result depends on that element alone, so the results do not depend on the threads.
"""

import os
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

T = TypeVar("T")


def cores() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Task(Generic[T]):
    """Work that is done once, by the thread that comes to it first."""

    def __init__(self, work: Callable[[], T]) -> None:
        self._work = work
        self._begun, self._done = threading.Lock(), threading.Lock()
        self._done.acquire()
        self._value: T
        self._error: BaseException | None = None

    def run(self) -> None:
        """Do it, unless somebody has begun."""
        if not self._begun.acquire(blocking=False):
            return
        work = self._work
        del self._work  # what it holds may go when it is done, however long the task is remembered
        try:
            self._value = work()
        except BaseException as error:
            self._error = error
        finally:
            self._done.release()

    def result(self) -> T:
        """What the work returned or raised; it is done here unless the other thread has begun."""
        self.run()
        with self._done:
            if self._error is not None:
                raise self._error
            return self._value


class Worker:
    """One thread that helps the caller's. It starts with the first task and ends with :meth:`close`.

    Attributes:
        alone: whether there is no other thread.
    """

    def __init__(self, threads: int = 2) -> None:
        """With fewer than 2 ``threads`` there is no other one: everything is done on the caller's."""
        self.alone = threads < 2
        self._tasks: SimpleQueue[Task[Any] | None] = SimpleQueue()
        self._thread: threading.Thread | None = None

    def submit(self, work: Callable[[], T]) -> Task[T]:
        """Have the other thread do ``work`` when it has done what came before."""
        task = Task(work)
        if not self.alone:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="pfslam", daemon=True)
                self._thread.start()
            self._tasks.put(task)
        return task

    def split(self, work: Callable[[slice], T], count: int, *, worth: int, pieces: int = 2) -> list[T]:
        """``work`` on ``count`` elements in ``pieces``, answered in order; whoever is free takes the next one.

        This thread takes them from the front, the other one from the back. Fewer than ``worth`` elements are done at
        once, here: waking the other thread takes about 0.1 ms.
        """
        if self.alone or count < worth:
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

        other = self.submit(lambda: take(left.pop))
        take(left.popleft)
        other.result()
        return [results[k] for k in range(pieces)]

    def close(self) -> None:
        """Finish what is queued and end the thread; a closed worker starts again when it is needed."""
        if self._thread is not None:
            self._tasks.put(None)
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        while (task := self._tasks.get()) is not None:
            task.run()
