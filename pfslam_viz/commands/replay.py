"""``pfslam-viz replay``: run the filter over a recording, and send every step to where the user wants it."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from pfslam_viz import console
from pfslam_viz.commands.choices import ConfigChoice, DetailChoice, RecordingChoice, SinkChoice
from pfslam_viz.commands.interrupt import Interrupted, stop_on_interrupt
from pfslam_viz.commands.progress import kernels, replay_progress
from pfslam_viz.commands.summary import summary
from pfslam_viz.compiling.clock import CLOCK, clock
from pfslam_viz.config import Config
from pfslam_viz.errors import InputError
from pfslam_viz.files import check_writable
from pfslam_viz.outputs import EXPORTED, check_export
from pfslam_viz.recordings.findings import SEVERITIES, of
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result

if TYPE_CHECKING:
    from pfslam_viz.viewer.stream import ReplayStream


LOSSES = ("camera: ", "truth: ", "relations: ")
"""How notes begin that may say that a whole part of a recording is not used; then -q does not hide them."""


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
        check_export(export)
        _check_apart(sinks.save, export)
    else:
        sinks = sinks.or_viewer()
    sinks.check()
    config = config_choice.load()
    chosen.require()
    sinks.check_screen()
    sinks.tell_folder(quiet)
    recording = read(chosen, quiet)
    with kernels([config], recording, viewer=sinks.any, quiet=quiet), stop_on_interrupt() as stopped:
        with ExitStack() as stack:
            stream = open_stream(stack, recording, config, sinks, detail, stopped)
            result, log_seconds = _replay(recording, config, stream, stopped, quiet)
            result.require_map()
            if stream is not None:
                stream.finish(result)
            seconds = perf_counter() - started - CLOCK.seconds
            early = stopped()
        if export is not None and len(result.stamps):
            with console.status("writing the export", quiet):
                _export(result, export)
    if not quiet:
        left_out = stream.left_out if stream is not None else ()
        shown = summary(result, seconds, log_seconds, sinks.save, left_out)
        console.results(to_stderr=sinks.stdout).print(shown)
    tell_doubts(recording)
    kept_or_raise(result, [sinks.save, export], early or (stopped() and not sinks.serve))  # which ends so


def _check_apart(save: Path | None, export: Path) -> None:
    """Raise InputError where the recording would stand in the way of the export's folder, or in place of its files."""
    if save is None:
        return
    file, folder = save.resolve(), export.resolve()
    if file == folder or file in folder.parents or (file.parent == folder and file.name in EXPORTED):
        raise InputError(
            f"--save {save} and --export {export}: one would stand in the place of the other; name them apart"
        )


def read(chosen: RecordingChoice, quiet: bool, label: str = "") -> Recording:
    """The recording; what was wrong with its files is told, and what is doubtful also to those who want quiet.

    ``label`` says which of several it is.
    """
    of_which = f"{label}: " if label else ""
    with console.status(f"reading {chosen.name}", quiet):
        recording = chosen.load()
    for note in recording.notes:
        if not quiet:
            console.tell(f"note: {of_which}{note}")
        elif note.startswith(LOSSES) and "left out" in note:
            console.tell(f"warning: {of_which}{note}")
    tell_doubts(recording, of_which)
    return recording


def tell_doubts(recording: Recording, of_which: str = "") -> None:
    """What makes the recording doubtful, or wrong where it was forced: a line each on stderr."""
    for severity in SEVERITIES[:2]:
        for finding in of(recording.findings, severity):
            console.tell(f"{severity}: {of_which}{finding.line}")


def kept_or_raise(result: Result, outputs: Sequence[Path | None], stopped: bool = False) -> None:
    """Raise Interrupted for an interrupted run, with the ``outputs`` that hold what was done.

    ``stopped``: the user wanted to end, if only after the last scan.
    """
    if not (result.interrupted or stopped):
        return
    kept = [str(path) for path in outputs if path is not None]
    held = f"; {' and '.join(kept)} {'holds' if len(kept) == 1 else 'hold'}" if kept else ""
    if not result.interrupted:
        raise Interrupted(f"interrupted after the last scan{f'{held} the whole run' if held else ''}")
    held = f"{held} them" if held else ""
    raise Interrupted(f"interrupted after scan {len(result.stamps)} of {len(result.recording)}{held}")


def open_stream(
    stack: ExitStack,
    recording: Recording,
    config: Config,
    sinks: SinkChoice,
    detail: DetailChoice,
    stopped: Callable[[], bool] = lambda: False,
) -> "ReplayStream | None":
    """A stream to the chosen sinks, which ``stack`` closes; None where nothing was chosen.

    ``stopped`` says whether the user wants to end.
    """
    if not sinks.any:
        return None
    from pfslam_viz.viewer.stream import replay_stream

    sink = stack.enter_context(sinks.open())
    sink.hurry = stopped
    return replay_stream(recording, config, sink, detail.options())


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
                before = clock()
                stream.log(step)
                log_seconds += clock() - before
            progress.advance()
            if stopped():
                break
        return replay.result(), log_seconds


def _export(result: Result, folder: Path) -> None:
    from pfslam_viz.evaluation.metrics import metrics
    from pfslam_viz.export import export

    export(result, folder, metrics(result))
