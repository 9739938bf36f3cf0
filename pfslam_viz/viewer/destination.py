"""One place that a recording goes to, and how it is left in time where it hangs."""

import threading
from dataclasses import dataclass

import rerun as rr

from pfslam_viz.viewer.stdout_pipe import StdoutPipe


@dataclass
class Destination:
    """One place that data goes to."""

    name: str
    stream: rr.RecordingStream
    live: bool
    to_file: bool = False
    pipe: StdoutPipe | None = None
    slow: int = 0

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
