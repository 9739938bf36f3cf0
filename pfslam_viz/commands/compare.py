"""``pfslam-viz compare``: one recording under several configurations, side by side in one file."""

from time import perf_counter

from pfslam_viz import console
from pfslam_viz.commands.choices import ConfigChoice, DetailChoice, RecordingChoice, SinkChoice
from pfslam_viz.commands.interrupt import stop_on_interrupt
from pfslam_viz.commands.progress import kernels, replay_progress
from pfslam_viz.commands.replay import kept_or_raise, read, tell_doubts
from pfslam_viz.commands.summary import comparison
from pfslam_viz.compiling.clock import CLOCK
from pfslam_viz.errors import InputError
from pfslam_viz.viewer.compare import compare


def run(
    chosen: RecordingChoice,
    config_choices: list[ConfigChoice],
    sinks: SinkChoice,
    detail: DetailChoice,
    quiet: bool = False,
) -> None:
    """Run every configuration over the recording and log them together."""
    if len(config_choices) < 2:
        raise InputError("compare needs two configurations or more: --config paper --config default")
    sinks = sinks.or_viewer()
    sinks.check()
    configs = [choice.load() for choice in config_choices]
    chosen.require()
    sinks.check_screen()
    sinks.tell_folder(quiet)
    started = perf_counter()
    recording = read(chosen, quiet)
    with kernels(configs, recording, viewer=True, quiet=quiet), sinks.open() as sink:
        with replay_progress(recording, quiet, "compare", len(configs)) as bar, stop_on_interrupt() as stopped:
            sink.hurry = stopped
            results = compare(
                recording, configs, sink, detail.options(), on_step=lambda *_: bar.advance(), stopped=stopped
            )
        seconds = perf_counter() - started - CLOCK.seconds
    if not quiet:
        console.results(to_stderr=sinks.stdout).print(comparison(results, seconds, sinks.save))
    tell_doubts(recording)
    kept_or_raise(results[0], [sinks.save])
