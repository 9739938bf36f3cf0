"""A second thread beside the filter's: kernels release the interpreter's lock, so that two cores can work."""

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any


def cores() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Worker:
    """One thread that does what it is given, in order. It starts with the first task and ends with :meth:`close`."""

    def __init__(self) -> None:
        self._pool: ThreadPoolExecutor | None = None

    def submit(self, task: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Queue a task; a closed worker starts again."""
        if self._pool is None:
            self._pool = ThreadPoolExecutor(1, "pfslam")
        return self._pool.submit(task, *arguments)

    def close(self) -> None:
        """Finish what is queued and end the thread."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
