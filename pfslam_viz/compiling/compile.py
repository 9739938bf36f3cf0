"""Compiles kernels before they are called, in two processes where there is a cache to share, with progress.

What is in the cache is loaded. The rest is compiled from both ends of the list, by this process and by one that is
started for it; what a run needs later only is compiled there while it runs. A kernel that is called before its turn has
come is waited for if the other process is at it, and otherwise compiled here: all of this changes when a kernel is
compiled, and nothing else.
"""

import itertools
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from subprocess import DEVNULL, PIPE, Popen
from threading import Event, Lock, Thread

from pfslam_viz.compiling.cache import use_cache
from pfslam_viz.compiling.clock import CLOCK
from pfslam_viz.compiling.kernel import find, types_of
from pfslam_viz.compiling.needed import Needed
from pfslam_viz.compiling.quick import quick_numba
from pfslam_viz.compiling.stored import NotStoredError, Stored
from pfslam_viz.slam.worker import cores

OnProgress = Callable[[int, int], object]
"""Is told how many kernels of how many are compiled."""

FEWEST = 4  # kernels that are worth another process, which takes half a second to start
OTHER = "pfslam_viz.compiling.serve"


class Compiling:
    """Kernels that are being compiled: here, and by another process. It is closed when nobody needs them any more."""

    def __init__(self, say: Callable[[str], object] = lambda line: None) -> None:
        """``say`` is told what is wrong with the cache."""
        self._say = cache(say)
        self._lock = Lock()
        self._first: deque[str] = deque()
        self._later: deque[str] = deque()
        self._there: dict[str, Event] = {}  # what the other process is at, and when it is done
        self._other: Popen[str] | None = None
        self._thread: Thread | None = None
        self._progress: Callable[[], object] = lambda: None

    def prepare(self, wanted: Needed, on_progress: OnProgress = lambda done, all_: None) -> int:
        """Load or compile what is needed at first; how many had to be compiled. What is needed later is begun."""
        missing = [name for name in wanted.first if not self._load(name)]
        later = [name for name in wanted.later if not self._load(name)]
        if not missing and not later:
            return 0
        CLOCK.start()
        try:
            total, count = len(missing), itertools.count(1)
            self._progress = lambda: on_progress(next(count), total)
            if missing:
                on_progress(0, total)
            self._first.extend(missing)
            self._later.extend(later)
            if use_cache() and len(missing) + len(later) >= FEWEST and cores() > 1:
                self._start()
            while (name := self._take(self._first.popleft)) is not None:
                self._compile(name)
                self._progress()
            for name in missing:
                self._compile(name)  # what the other process compiled is loaded
            if missing:
                on_progress(total, total)
        finally:
            self._progress = lambda: None
            CLOCK.stop()
        return len(missing)

    def close(self) -> None:
        """End the other process; what it has not compiled, a run that needs it will."""
        with self._lock:
            self._first.clear()
            self._later.clear()
        if self._other is not None:
            self._other.terminate()
            self._other.wait()
        if self._thread is not None:
            self._thread.join()

    def _take(self, pop: Callable[[], str]) -> str | None:
        with self._lock:
            try:
                return pop()
            except IndexError:
                return None

    def _load(self, name: str) -> bool:
        """Load a kernel from the cache, if it is there."""
        compiled, signature = find(name)
        if not isinstance(compiled._cache, Stored):
            compiled._cache = Stored(compiled._cache, lambda: False, self._say)
        compiled._cache._fetch = lambda: self._fetch(name)
        compiled._cache.only_load = True
        try:
            compiled.compile(types_of(compiled, signature))
        except NotStoredError:
            return False
        finally:
            compiled._cache.only_load = False
        return True

    def _compile(self, name: str) -> None:
        """Compile a kernel here, unless the other process is at it or has done it."""
        compiled, signature = find(name)
        compiled.compile(types_of(compiled, signature))

    def _fetch(self, name: str) -> bool:
        """Wait for the other process where it compiles this kernel; False where it does not, and will not."""
        with self._lock:
            for waiting in (self._first, self._later):
                if name in waiting:
                    waiting.remove(name)
            there = self._there.get(name)
        if there is None:
            return False
        CLOCK.start()
        there.wait()
        CLOCK.stop()
        return True

    def _start(self) -> None:
        command = [sys.executable, "-m", OTHER]
        try:
            self._other = Popen(
                command, stdin=PIPE, stdout=PIPE, stderr=DEVNULL, text=True, start_new_session=True, bufsize=1
            )
        except OSError:
            return  # this process will do it alone
        self._thread = Thread(target=self._feed, args=(self._other,), name="compiling", daemon=True)
        self._thread.start()

    def _feed(self, other: "Popen[str]") -> None:
        """Give the other process a kernel at a time, those needed at first from the end."""
        assert other.stdin is not None and other.stdout is not None
        while True:
            with self._lock:
                first = bool(self._first)
                if not first and not self._later:
                    break
                name = self._first.pop() if first else self._later.popleft()
                done = self._there[name] = Event()
            try:
                other.stdin.write(name + "\n")
                answered = other.stdout.readline()
            except OSError:
                answered = ""
            done.set()
            if not answered:
                break  # it ended; whoever needs the kernel compiles it
            if first:
                self._progress()
        with suppress(OSError):
            other.stdin.close()
        other.wait()


@contextmanager
def compiling(
    wanted: Needed, on_progress: OnProgress = lambda done, all_: None, say: Callable[[str], object] = lambda line: None
) -> Iterator[int]:
    """Kernels that are compiled, and how many had to be; what is ``wanted`` later is compiled beside what is done."""
    process = Compiling(say)
    try:
        with quick_numba():
            count = process.prepare(wanted, on_progress)
        yield count
    finally:
        process.close()


def compile_all(wanted: Needed, on_progress: OnProgress = lambda done, all_: None) -> int:
    """Compile everything that is ``wanted``, or load it; how many kernels had to be compiled."""
    process = Compiling()
    try:
        with quick_numba():
            return process.prepare(Needed((*wanted.first, *wanted.later)), on_progress)
    finally:
        process.close()
