"""Running the filter from Python: what ``import pfslam_viz`` offers besides the types."""

from collections.abc import Callable
from pathlib import Path

from pfslam_viz.config import Config, load_config
from pfslam_viz.files import check_writable, replaced
from pfslam_viz.outputs import check_recording
from pfslam_viz.recordings.catalog import load_recording
from pfslam_viz.recordings.checking.check import check, refuse_wrong
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result
from pfslam_viz.step import Step


def run(
    recording: Recording | str | Path,
    config: Config | str | Path = "default",
    *,
    on_step: Callable[[Step], None] | None = None,
    texture: bool = True,
    threads: int | None = None,
    force: bool = False,
) -> Result:
    """Run the filter over a recording to its end.

    Args:
        recording: a Recording, or what :func:`~pfslam_viz.recordings.catalog.load_recording` takes: a name or a path.
        config: a Config, or what :func:`~pfslam_viz.config.load_config` takes: a name or a path.
        on_step: called with the Step of every scan; its grids are live views, to be copied where they are kept.
        texture: whether to paint the floor, where there are images and the configuration wants it.
        threads: 1 or 2; None takes 2 if there are as many cores. The result does not depend on it.
        force: whether to run over a recording that was found to be wrong.

    A recording that was not checked is checked first, and mended where that is safe: ``result.recording`` is what was
    run over, with ``findings``.

    The first run on a machine compiles the kernels, which takes about half a minute.

    Raises:
        InputError: the recording or the configuration is not there or cannot be used, or the recording is wrong.
    """
    replay = Replay(_recording(recording, force), _config(config), texture=texture, threads=threads)
    for step in replay:
        if on_step is not None:
            on_step(step)
    return replay.result()


def save(
    recording: Recording | str | Path,
    config: Config | str | Path,
    path: str | Path,
    *,
    texture: bool = True,
    threads: int | None = None,
    force: bool = False,
) -> Result:
    """Run as :func:`run` does, and write the run to a ``.rrd`` file that the Rerun viewer opens.

    The file gets its name when it is complete; what ends the run early, Ctrl-C too, leaves none, and a file that was
    there before as it was.

    Raises:
        InputError: as :func:`run`, or ``path`` cannot be written, or is there and is no Rerun recording of ours;
            before the run starts.
        PfslamError: the run came out empty; there is no map to look at.
    """
    from pfslam_viz.viewer.sinks import open_sinks
    from pfslam_viz.viewer.stream import replay_stream

    check_writable(Path(path))
    check_recording(Path(path))
    drive, settings = _recording(recording, force), _config(config)
    with replaced(Path(path)) as unfinished, open_sinks(save=unfinished) as sink:
        stream = replay_stream(drive, settings, sink)
        result = run(drive, settings, on_step=stream.log, texture=texture, threads=threads)
        result.require_map()
        stream.finish(result)
    return result


def _recording(recording: Recording | str | Path, force: bool) -> Recording:
    checked = check(recording) if isinstance(recording, Recording) else load_recording(recording, force=True)
    if not force:
        refuse_wrong(checked, "force=True")
    return checked


def _config(config: Config | str | Path) -> Config:
    return config if isinstance(config, Config) else load_config(config)
