"""Ctrl-C that lets a run end in good order."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from pfslam_viz.errors import PfslamError


class Interrupted(PfslamError):
    """The user stopped the run (exit status 130). The message says what was kept."""

    exit_status = 130


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
