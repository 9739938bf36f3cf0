"""How long this process has compiled, so that no time of a filter has it."""

from threading import Lock
from time import perf_counter
from typing import Any

from numba.core import event


class CompileClock(event.Listener):
    """Sums up the seconds in which kernels are compiled, or waited for. What runs within another counts once."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._depth = 0
        self._began = self._sum = 0.0

    @property
    def seconds(self) -> float:
        """In all, also of what is going on."""
        with self._lock:
            return self._sum + (perf_counter() - self._began if self._depth else 0.0)

    def start(self) -> None:
        """Something is compiled."""
        with self._lock:
            if self._depth == 0:
                self._began = perf_counter()
            self._depth += 1

    def stop(self) -> None:
        """And is done."""
        with self._lock:
            self._depth -= 1
            if self._depth == 0:
                self._sum += perf_counter() - self._began

    def on_start(self, event: Any) -> None:
        """Numba begins to compile a function."""
        self.start()

    def on_end(self, event: Any) -> None:
        """Numba has compiled it."""
        self.stop()


CLOCK = CompileClock()
event.register("numba:compile", CLOCK)  # type: ignore[no-untyped-call]


def clock() -> float:
    """Seconds that pass, but for those in which kernels are compiled."""
    return perf_counter() - CLOCK.seconds
