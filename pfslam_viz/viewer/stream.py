"""Every Step of a replay, collected and handed on to be drawn."""

import time

from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result
from pfslam_viz.step import Step
from pfslam_viz.viewer.collector import Collector, StreamOptions
from pfslam_viz.viewer.colors import run_colors
from pfslam_viz.viewer.drawing import Drawing, send_scene
from pfslam_viz.viewer.framing import Framing
from pfslam_viz.viewer.sinks import Sink

BATCH_ROWS = 200
LIVE_SECONDS = 0.25  # a watched run is shown at least this often


class ReplayStream:
    """Logs a replay: :meth:`log` each Step, then :meth:`finish` with the Result."""

    def __init__(self, collector: Collector, drawing: Drawing, *, alone: bool = True) -> None:
        """``alone``: this is the recording's only run, so that its end settles the framing, the pages and the layout.

        What was collected is drawn before the recording is closed, also where a run ends without :meth:`finish`.
        """
        self._collector, self._drawing, self._alone = collector, drawing, alone
        self._flushed = time.monotonic()
        drawing.sink.before_close(self._close)

    @property
    def left_out(self) -> list[str]:
        """How much of what the recording does not hold whole is in it, a phrase each."""
        return self._collector.left_out

    def log(self, step: Step) -> None:
        """Log one scan. Scans are collected and drawn in batches.

        Raises PfslamError once nobody is left who would see it.
        """
        self._drawing.sink.check_read()
        self._collector.add(step)
        now = time.monotonic()
        if len(self._collector) == BATCH_ROWS or (self._drawing.sink.live and now - self._flushed > LIVE_SECONDS):
            self.flush()
            self._flushed = now

    def finish(self, result: Result) -> None:
        """Log what is known only at the end: the last maps, the trajectory in hindsight, the final framing."""
        self._drawing.sink.stopped = result.interrupted
        self._collector.finish(result)
        self.flush()
        framing = Framing.of_results([result]) if self._alone and len(result.stamps) else None
        self._drawing.finish(framing, self.left_out, result)

    def flush(self) -> None:
        """Draw what was collected so far."""
        batch, contents = self._collector.take()
        if batch is not None or contents:
            self._drawing.draw(batch, contents)

    def _close(self) -> None:
        self.flush()
        self._collector.close()


def replay_stream(
    recording: Recording, config: Config, sink: Sink, options: StreamOptions | None = None
) -> ReplayStream:
    """The stream of a recording's only run to a sink."""
    options = (options or StreamOptions()).settled(len(recording))
    color = run_colors([config])[0]
    drawing = Drawing(recording, config, sink, options.max_particles, color=color)
    send_scene([drawing], Framing.of_recording(recording))
    return ReplayStream(Collector(recording, config, options), drawing)
