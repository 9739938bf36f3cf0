"""One place that a recording goes to, and how it is left in time where it hangs."""

import errno
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import rerun as rr

from pfslam_viz.errors import PfslamError
from pfslam_viz.files import is_full_at
from pfslam_viz.viewer.stdout_pipe import LOOK_SECONDS, UNREAD, StdoutPipe


@dataclass
class Destination:
    """One place that data goes to; ``path`` is the file that is written, where it is one."""

    name: str
    stream: rr.RecordingStream
    live: bool
    path: Path | None = None
    pipe: StdoutPipe | None = None
    slow: int = 0

    @property
    def to_file(self) -> bool:
        """Whether it is a file, which is what must be right."""
        return self.path is not None

    def flush(self, seconds: Callable[[], float]) -> None:
        """Wait until what was sent is there. Raises RuntimeError where nothing was taken for so many ``seconds``.

        Of standard output, which may be read slowly, in small portions, between which Ctrl-C gets through.
        """
        if self.path is not None:
            self._flush_file(self.path, seconds())
            return
        if self.pipe is None:
            self.stream.flush(timeout_sec=seconds())
            return
        carried, since = self.pipe.carried, time.monotonic()
        while self.pipe.failure is None:
            try:
                self.stream.flush(timeout_sec=LOOK_SECONDS)
                return
            except RuntimeError:
                if self.pipe.carried != carried:
                    carried, since = self.pipe.carried, time.monotonic()
                elif time.monotonic() - since > seconds():
                    raise

    def _flush_file(self, path: Path, seconds: float) -> None:
        """Rerun does not say that a disk is full: it never answers again."""
        since = time.monotonic()
        while True:
            try:
                self.stream.flush(timeout_sec=min(LOOK_SECONDS, seconds))
                return
            except RuntimeError:
                if is_full_at(path):
                    raise PfslamError(f"{self.name}: cannot be written: {os.strerror(errno.ENOSPC)}") from None
                if time.monotonic() - since > seconds:
                    raise

    def raise_if_lost(self) -> None:
        """Raise PfslamError where this is standard output, and it takes no more."""
        if self.pipe is None or self.pipe.failure is None:
            return
        if self.pipe.failure == UNREAD:
            raise PfslamError("nobody reads standard output any more: the run has ended")
        raise PfslamError(f"standard output cannot be written: {self.pipe.failure}; what is there is cut off")

    def close(self, seconds: float) -> bool:
        """Disconnect; False where it hangs, and is left behind after ``seconds``."""
        closed = _close_in_time(self.stream, seconds)
        return (self.pipe is None or self.pipe.close(seconds)) and closed


_ABANDONED: list[rr.RecordingStream] = []


def _close_in_time(stream: rr.RecordingStream, seconds: float) -> bool:
    """Disconnect; a destination that hangs is left behind after ``seconds`` (False)."""
    thread = threading.Thread(target=stream.disconnect, daemon=True)
    thread.start()
    thread.join(seconds)
    if thread.is_alive():
        _ABANDONED.append(stream)  # dropping it would wait for the viewer, and so would Rerun's exit hook
        rr.unregister_shutdown()
        return False
    return True
