"""``pfslam-viz replay``: run the filter over a recording, and send every step to where the user wants it."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from pfslam_viz import console
from pfslam_viz.commands.choices import ConfigChoice, DetailChoice, RecordingChoice, SinkChoice
from pfslam_viz.commands.interrupt import Interrupted, stop_on_interrupt
from pfslam_viz.commands.progress import load_kernels, replay_progress
from pfslam_viz.commands.summary import summary
from pfslam_viz.config import Config
from pfslam_viz.files import check_writable
from pfslam_viz.recordings.findings import SEVERITIES, of
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result

if TYPE_CHECKING:
    from pfslam_viz.viewer.stream import ReplayStream


def run(
    chosen: RecordingChoice,
    config_choice: ConfigChoice,
    sinks: SinkChoice,
    detail: DetailChoice,
    export: Path | None = None,
    quiet: bool = False,
) -> None:
    """Everything that can be wrong is checked before the first scan; an interrupted run keeps what it has."""
    started = perf_counter()
    if export is not None:
        check_writable(export, folder=True)
    else:
        sinks = sinks.or_viewer()
    sinks.check()
    config = config_choice.load()
    chosen.require()
    sinks.check_screen()
    recording = read(chosen, quiet)
    load_kernels(quiet)
    with ExitStack() as stack:
        with stop_on_interrupt() as stopped:
            stream = open_stream(stack, recording, config, sinks, detail)
            result, log_seconds = _replay(recording, config, stream, stopped, quiet)
        result.require_map()
        if stream is not None:
            stream.finish(result)
        seconds = perf_counter() - started
    if export is not None and len(result.stamps):
        with console.status("writing the export", quiet):
            _export(result, export)
    if not quiet:
        left_out = stream.left_out if stream is not None else ()
        shown = summary(result, seconds, log_seconds, sinks.save, left_out)
        console.results(to_stderr=sinks.stdout).print(shown)
    tell_doubts(recording)
    kept_or_raise(result, [sinks.save, export])


def read(chosen: RecordingChoice, quiet: bool, label: str = "") -> Recording:
    """The recording; what was wrong with its files is told, and what is doubtful also to those who want quiet.

    ``label`` says which of several it is.
    """
    of_which = f"{label}: " if label else ""
    with console.status(f"reading {chosen.name}", quiet):
        recording = chosen.load()
    if not quiet:
        for note in recording.notes:
            console.tell(f"note: {of_which}{note}")
    tell_doubts(recording, of_which)
    return recording


def tell_doubts(recording: Recording, of_which: str = "") -> None:
    """What makes the recording doubtful, or wrong where it was forced: a line each on stderr."""
    for severity in SEVERITIES[:2]:
        for finding in of(recording.findings, severity):
            console.tell(f"{severity}: {of_which}{finding.line}")


def kept_or_raise(result: Result, outputs: Sequence[Path | None]) -> None:
    """Raise Interrupted for an interrupted run, with the ``outputs`` that hold what was done."""
    if not result.interrupted:
        return
    kept = [str(path) for path in outputs if path is not None]
    held = f"; {' and '.join(kept)} {'holds' if len(kept) == 1 else 'hold'} them" if kept else ""
    raise Interrupted(f"interrupted after scan {len(result.stamps)} of {len(result.recording)}{held}")


def open_stream(
    stack: ExitStack, recording: Recording, config: Config, sinks: SinkChoice, detail: DetailChoice
) -> "ReplayStream | None":
    """A stream to the chosen sinks, which ``stack`` closes; None where nothing was chosen."""
    if not sinks.any:
        return None
    from pfslam_viz.viewer.stream import replay_stream

    return replay_stream(recording, config, stack.enter_context(sinks.open()), detail.options())


def _replay(
    recording: Recording, config: Config, stream: "ReplayStream | None", stopped: Callable[[], bool], quiet: bool
) -> tuple[Result, float]:
    """Run the filter until the last scan or until ``stopped``; also the seconds that logging took."""
    log_seconds = 0.0
    replay = Replay(recording, config)
    if not quiet:
        for note in replay.recording.notes[len(recording.notes) :]:
            console.tell(f"note: {note}")
    with replay_progress(recording, quiet) as progress:
        for step in replay:
            if stream is not None:
                before = perf_counter()
                stream.log(step)
                log_seconds += perf_counter() - before
            progress.advance()
            if stopped():
                break
        return replay.result(), log_seconds


def _export(result: Result, folder: Path) -> None:
    from pfslam_viz.evaluation.metrics import metrics
    from pfslam_viz.export import export

    export(result, folder, metrics(result))
