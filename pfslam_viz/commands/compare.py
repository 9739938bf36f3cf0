"""``pfslam-viz compare``: one recording under several configurations, side by side in one file."""

from time import perf_counter

from pfslam_viz import console
from pfslam_viz.commands.choices import ConfigChoice, DetailChoice, RecordingChoice, SinkChoice
from pfslam_viz.errors import InputError


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
    for choice in config_choices:
        choice.load()
    started = perf_counter()
    with console.status(f"reading {chosen.name}", quiet):
        recording = chosen.load()
    configs = [choice.load(recording.format) for choice in config_choices]
    from pfslam_viz.viewer.compare import compare

    console.load_kernels(quiet)
    runs = len(configs)
    label = " | ".join(config.name for config in configs)
    with sinks.open() as sink, console.ReplayProgress(len(recording) * runs, recording.duration * runs, quiet) as bar:
        results = compare(recording, configs, sink, detail.options(), on_step=lambda *_: bar.advance())
    if quiet:
        return
    out = console.results(to_stderr=sinks.stdout)
    seconds = perf_counter() - started
    out.print(f"{label}: {seconds:.1f} s in all", markup=False)
    for result in results or ():
        out.print(console.summary(result, seconds / runs))
