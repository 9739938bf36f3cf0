"""One recording under several configurations, in one Rerun recording: side by side, scrubbed together."""

import re
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing

from pfslam_viz.config import Config
from pfslam_viz.errors import InputError
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result
from pfslam_viz.step import Step
from pfslam_viz.viewer import colors
from pfslam_viz.viewer.collector import Collector, StreamOptions
from pfslam_viz.viewer.drawing import Drawing, send_scene
from pfslam_viz.viewer.framing import Framing, aspect_of
from pfslam_viz.viewer.sinks import Sink
from pfslam_viz.viewer.stream import ReplayStream

RESERVED = ("dead_reckoning", "truth", "overview")


def run_names(configs: Sequence[Config]) -> list[str]:
    """A distinct name for each configuration, fit for an entity path."""
    names: list[str] = []
    for config in configs:
        base = re.sub(r"[^A-Za-z0-9_.-]+", "_", config.name).strip("_.") or "run"
        base = f"{base}_run" if base in RESERVED else base
        name, count = base, 1
        while name in names:
            count += 1
            name = f"{base}_{count}"
        names.append(name)
    return names


def compare(
    recording: Recording,
    configs: Sequence[Config],
    sink: Sink,
    options: StreamOptions | None = None,
    on_step: Callable[[str, Step], None] | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> list[Result]:
    """Run every configuration over the recording, scan by scan side by side, and log them together.

    ``on_step`` is called with the run's name after each of its scans; ``stopped`` is asked before every scan, and True
    ends all runs there. Returns a Result for each configuration. Raises InputError for more configurations than there
    are colours.
    """
    if len(configs) > len(colors.RUNS):
        raise InputError(f"{len(configs)} configurations: at most {len(colors.RUNS)} can be told apart by colour")
    names = run_names(configs)
    panels = len(names) + 1
    options = (options or StreamOptions()).settled(len(recording))
    drawings, streams = [], []
    for index, (config, name, color) in enumerate(zip(configs, names, colors.run_colors(configs), strict=True)):
        shared = index == 0
        drawing = Drawing(
            recording, config, sink, options.max_particles, run=name, color=color, shared=shared, relative=True
        )
        drawings.append(drawing)
        streams.append(ReplayStream(Collector(recording, config, options, name, shared=shared), drawing, alone=False))
    send_scene(drawings, Framing.of_recording(recording, aspect_of(panels)))
    replays = [Replay(recording, config) for config in configs]
    with ExitStack() as stack:
        iterators = [stack.enter_context(closing(_steps(replay))) for replay in replays]
        for _ in range(len(recording)):
            if stopped():
                break
            for name, iterator, stream in zip(names, iterators, streams, strict=True):
                step = next(iterator)
                stream.log(step)
                if on_step is not None:
                    on_step(name, step)
        else:
            for iterator in iterators:  # lets each settle what is known in hindsight
                next(iterator, None)
        results = [replay.result() for replay in replays]
    for stream, result in zip(streams, results, strict=True):
        result.require_map()
        stream.finish(result)
    if len(results[0].stamps):
        left_out = list(dict.fromkeys(phrase for stream in streams for phrase in stream.left_out))
        send_scene(drawings, Framing.of_results(results, aspect_of(panels)), left_out, results)
    return results


def _steps(replay: Replay) -> Generator[Step, None, None]:
    yield from replay
