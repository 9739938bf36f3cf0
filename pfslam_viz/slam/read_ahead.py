"""Scans that are read while those before them are worked on."""

from collections.abc import Callable
from functools import partial
from typing import Generic, TypeVar

from pfslam_viz.slam.worker import Task, Worker

T = TypeVar("T")

BATCH = 16  # that are read at a time: waking a thread costs as much as reading one


class ReadAhead(Generic[T]):
    """What ``read`` answers for one number after the other, from ``first`` to before ``end``.

    A worker's other thread reads the next ones, some at a time. ``read`` must depend on the number alone.
    """

    def __init__(self, read: Callable[[int], T], first: int, end: int, worker: Worker) -> None:
        self._read, self._end, self._worker = read, end, worker
        self._next = first  # the first number that nobody was asked to read
        self._batches: list[Task[list[T]]] = []
        self._there: list[T] = []  # in reverse

    def take(self) -> T:
        """The next one. Raises IndexError after the last."""
        if not self._there:
            while len(self._batches) < 2 and self._next < self._end:
                self._order(1 if self._worker.alone else BATCH)
            self._there = self._batches.pop(0).result()[::-1]
        return self._there.pop()

    def _order(self, count: int) -> None:
        numbers = range(self._next, min(self._next + count, self._end))
        self._next = numbers.stop
        self._batches.append(self._worker.submit(partial(self._read_all, numbers)))

    def _read_all(self, numbers: range) -> list[T]:
        return [self._read(k) for k in numbers]
