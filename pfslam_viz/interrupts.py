"""Ctrl-C, and requests to terminate, that wait until what is being done can be left in good order."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


@contextmanager
def stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """A function that says whether Ctrl-C was pressed; a second Ctrl-C raises KeyboardInterrupt as ever.

    Between two scans is a good place to stop; in the middle of writing one to a file is not. A request to terminate
    counts as well. Outside the main thread, where signals cannot be caught, the function stays False.
    """
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped.is_set
        return

    def handle(number: int, frame: FrameType | None) -> None:
        if stopped.is_set():
            raise KeyboardInterrupt
        stopped.set()

    previous = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped.is_set
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextmanager
def deferred() -> Iterator[None]:
    """Within the block, Ctrl-C and a request to terminate wait for its end; a second one does not."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        if waiting:
            _deliver(previous[signal.Signals(number)], number, frame)
        waiting.append(number)

    previous = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    if waiting:
        _deliver(previous[signal.Signals(waiting[0])], waiting[0], None)


def _deliver(handler: Any, number: int, frame: FrameType | None) -> None:
    """Have done what would have been done without us."""
    if callable(handler):
        handler(number, frame)
    elif handler == signal.SIG_DFL:
        signal.raise_signal(number)
