"""Where a recording goes: a file, a viewer, a server, standard output, or several of these at once.

Every destination has a stream of its own, all of one recording. A viewer that goes away, or hangs, costs its picture
and nothing else: the file is complete, and :attr:`Sink.messages` says what happened.
"""

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from uuid import uuid4

import rerun as rr

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.files import replaced
from pfslam_viz.interrupts import deferred
from pfslam_viz.names import path_for_rerun
from pfslam_viz.outputs import APPLICATION_ID as APPLICATION_ID
from pfslam_viz.outputs import check_recording
from pfslam_viz.viewer import stdout_pipe
from pfslam_viz.viewer.connections import check_answers, serve_at, spawn_viewer
from pfslam_viz.viewer.destination import Destination
from pfslam_viz.viewer.stdout_pipe import StdoutPipe
from pfslam_viz.viewer.web_viewer import web_viewer

FLUSH_SECONDS = 2.0  # a viewer has this long to take a block before it counts as slow
PATIENCE = 3  # slow blocks in a row before it counts as gone
WRITE_SECONDS = 30.0  # a disk has this long to take a block; Rerun does not always notice that it cannot
HURRY_SECONDS = 2.0  # a reader of standard output has this long to go on reading once the user wants to end
CLOSE_SECONDS = 20.0  # a viewer has this long to take the rest at the end


@dataclass
class Sink:
    """All destinations of one recording; data is encoded once and sent to each.

    Attributes:
        messages: what happened to the destinations, a sentence each.
        path: the file that is written, under its final name.
        on_message: called with each message as it is added.
        stopped: the run was stopped before its end; a server does not wait for Ctrl-C then.
        hurry: says whether the user wants the run to end, so that nobody is waited for who reads nothing.
    """

    messages: list[str] = field(default_factory=list)
    path: Path | None = None
    on_message: Callable[[str], None] | None = None
    stopped: bool = False
    hurry: Callable[[], bool] = lambda: False
    _destinations: list[Destination] = field(default_factory=list)
    _closers: list[Callable[[], None]] = field(default_factory=list)
    _written: Path | None = None

    @property
    def recording(self) -> rr.RecordingStream:
        """The stream to the first destination; one that leads nowhere when all are gone."""
        if not self._destinations:
            return rr.RecordingStream(APPLICATION_ID, default_enabled=False)
        return self._destinations[0].stream

    @property
    def live(self) -> bool:
        """Whether somebody may be watching: blocks should be short."""
        return any(d.live for d in self._destinations)

    @property
    def size(self) -> int | None:
        """Bytes of the file as written so far; None when no file is written."""
        for path in (self._written, self.path):
            if path is not None and path.is_file():
                return path.stat().st_size
        return None

    def say(self, message: str) -> None:
        """Add to the messages."""
        self.messages.append(message)
        if self.on_message is not None:
            self.on_message(message)

    def before_close(self, action: Callable[[], None]) -> None:
        """Call ``action`` before the destinations are closed, whatever ends the run."""
        self._closers.append(action)

    def log_static(self, path: str, *archetypes: Any) -> None:
        """Log archetypes that hold for the whole recording."""
        for d in self._destinations:
            d.stream.log(path, *archetypes, static=True)

    def send_columns(self, path: str, times: Sequence[rr.TimeColumn], columns: Iterable[Any]) -> None:
        """Send many rows of one entity at once."""
        columns = list(columns)
        for d in self._destinations:
            d.stream.send_columns(path, times, columns)

    def send_blueprint(self, blueprint: Any, live: bool = True) -> None:
        """Make this the layout. With ``live`` False only where nobody can have changed it already: in files."""
        for d in self._destinations:
            if live or not d.live:
                d.stream.send_blueprint(blueprint, make_active=True, make_default=True)

    def push(self) -> None:
        """Have what was sent go to its destinations, without waiting for it; :meth:`check` tells of failures."""
        for d in self._destinations:
            with suppress(RuntimeError):
                d.stream.flush(timeout_sec=0.0)

    def check(self) -> None:
        """Wait until what was sent is there. A viewer, or reader of standard output, that is gone is dropped.

        Raises PfslamError when the file cannot be written, as on a full disk.
        """
        self.check_read()
        for d in list(self._destinations):
            try:
                d.flush(lambda: self._seconds(d))  # noqa: B023 - called at once
                d.slow = 0
            except (RuntimeError, PfslamError) as error:
                d.slow += 1
                if d.to_file:
                    self._destinations.remove(d)
                    d.close(1.0)
                    if isinstance(error, PfslamError):
                        raise
                    raise PfslamError(f"{d.name}: cannot be written (is the disk full?): {error}") from None
                if "timed out" not in str(error) or not d.live:
                    self._drop(d, "went away")
                elif d.slow >= PATIENCE:
                    self._drop(d, "stopped answering")

    def check_read(self) -> None:
        """Drop standard output if nobody reads it any more or it takes no more, without waiting for anything.

        Raises PfslamError where it was the only destination: there is nothing left to run for.
        """
        for d in [d for d in self._destinations if d.pipe is not None and d.pipe.failure]:
            if len(self._destinations) > 1:
                self._drop(d, "went away")
                continue
            self._destinations.remove(d)
            d.close(1.0)
            d.raise_if_lost()

    def _seconds(self, destination: Destination) -> float:
        """How long it is waited for."""
        if destination.live:
            return FLUSH_SECONDS
        return HURRY_SECONDS if destination.pipe is not None and self.hurry() else WRITE_SECONDS

    def _drop(self, destination: Destination, why: str) -> None:
        rest = [d for d in self._destinations if d is not destination]
        to = f"; {self.path} is still being written" if self.path is not None else ""
        self._destinations = rest
        self.say(f"{destination.name} {why} in mid-run: the run goes on without it{to}")
        destination.close(1.0)

    def _close_files(self) -> None:
        while self._closers:
            self._closers.pop(0)()
        self.check()
        for d in [d for d in self._destinations if not d.live]:
            self._destinations.remove(d)
            closed = d.close(self._seconds(d))
            if not closed and d.to_file:
                raise PfslamError(f"{d.name}: could not be completed within {WRITE_SECONDS:.0f} s")
            d.raise_if_lost()

    def _close(self) -> None:
        self._close_files()
        while self._destinations:
            d = self._destinations.pop()
            if not d.close(CLOSE_SECONDS):
                self.say(f"{d.name} did not take everything within {CLOSE_SECONDS:.0f} s")


@contextmanager
def open_sinks(
    *,
    save: Path | None = None,
    spawn: bool = False,
    serve: bool | str | None = None,
    bind: str = "127.0.0.1",
    web: bool = False,
    connect: str | None = None,
    stdout: bool = False,
    application_id: str = APPLICATION_ID,
    recording_id: str | None = None,
    blueprint: Any = None,
    name: str | None = None,
    on_message: Callable[[str], None] | None = None,
    hold: Callable[[], None] | None = None,
) -> Iterator[Sink]:
    """Open every destination that is asked for, and close each properly.

    Args:
        save: the file to write. It is written beside itself under a temporary name and moved there when the block
            ends, also when Ctrl-C ends it: what was logged so far opens. Any other exception leaves no file.
        spawn: open the viewer and stream to it.
        serve: serve viewers over gRPC, on ``bind``; True, or the address itself.
        bind: the address to serve on. Any but the loopback is warned of in the messages.
        web: with ``serve``, serve Rerun's web viewer too, on the loopback; the messages say where.
        connect: stream to the viewer or server at this URL.
        stdout: write to standard output.
        application_id: viewers keep a layout per application.
        recording_id: a new one when None.
        blueprint: a layout to send first.
        name: what the viewer calls the recording.
        on_message: called with each of the sink's messages as it comes; by default they go to stderr.
        hold: what keeps a server up once the whole run is over; by default it serves until Ctrl-C.

    Raises InputError for a file that cannot be written, or that is there and is no recording of ours, an address that
    cannot be bound, a URL where nobody answers.
    """
    sink = Sink(path=save, on_message=on_message or (lambda message: print(message, file=sys.stderr)))
    hold = hold or (lambda: _until_stopped(sink))
    identity = recording_id or str(uuid4())

    def stream(live: bool) -> rr.RecordingStream:
        batching = rr.ChunkBatcherConfig(flush_tick=0.2 if live else 30.0)
        made = rr.RecordingStream(application_id, recording_id=identity, batcher_config=batching)
        for timeline in (made.set_log_time_enabled, made.set_log_tick_enabled):
            timeline(False)
        return made

    def add(
        name: str,
        opened: rr.RecordingStream,
        live: bool = False,
        path: Path | None = None,
        pipe: StdoutPipe | None = None,
    ) -> None:
        sink._destinations.append(Destination(name, opened, live, path, pipe))

    served: str | None = None
    with ExitStack() as web_server, ExitStack() as files:
        if save is not None:
            check_recording(save, application_id)
            path_for_rerun(save)
            sink._written = files.enter_context(replaced(save))
            to_file = stream(live=False)
            to_file.save(path_for_rerun(sink._written))
            add(str(save), to_file, path=sink._written)
        if stdout:
            to_stdout = stream(live=False)
            pipe = StdoutPipe() if stdout_pipe.fits() else None
            to_stdout.stdout()
            add("standard output", to_stdout, pipe=pipe)
        if serve:
            address = serve if isinstance(serve, str) else bind
            to_server = stream(live=True)
            server, served = serve_at(address, sink.say)
            to_server.set_sinks(server)
            add("the server", to_server, live=True)
            if web:
                web_server.enter_context(web_viewer(served, sink.say))
        if spawn:
            connect_to = spawn_viewer()
            to_viewer = stream(live=True)
            to_viewer.connect_grpc(connect_to)
            add("the viewer", to_viewer, live=True)
        if connect is not None:
            check_answers(connect)
            to_url = stream(live=True)
            to_url.connect_grpc(connect)
            add(f"the viewer at {connect}", to_url, live=True)
        if not sink._destinations:
            raise InputError("nowhere to send the recording to: pass --save, --spawn, --serve, --connect or --stdout")
        if name is not None:
            for d in sink._destinations:
                d.stream.send_recording_name(name)
        if blueprint is not None:
            sink.send_blueprint(blueprint)
        try:
            yield sink
        except KeyboardInterrupt:
            sink.hurry = lambda: True
            sink._close()
            files.close()  # without the exception: what was logged so far is kept
            raise
        except BaseException:
            sink._closers.clear()
            with suppress(PfslamError):  # what ended the run is what the user must hear of
                sink._close()
            raise
        with deferred():  # the file is complete in a moment, and then it has its name
            sink._close_files()
            files.close()
        if served is not None and not (sink.stopped or sink.hurry()):
            with suppress(KeyboardInterrupt):
                sink.say(f"the run is over; still serving at {served} until Ctrl-C")
                hold()
        sink._close()


def _until_stopped(sink: Sink) -> None:
    """Until Ctrl-C, which either is raised as ever or waits for us to see it."""
    while not sink.hurry():
        time.sleep(0.1)
