"""``rerun-importer-pfslam``: with it on PATH, ``rerun Hokuyo21.npz`` opens the replay in the viewer.

The viewer starts every ``rerun-importer-*`` it finds for every file it is asked to open, a folder's files too. So a
path that is not ours is refused, by its name alone, before anything heavy is imported.
"""

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from pfslam_viz.recordings import formats

NOT_OURS = 66
"""The exit status by which an importer says that a path is for somebody else."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Replay the recording at the path given by the viewer to standard output.

    Returns the exit status: 0 done, 66 not ours, and as the command line has it for failures (one line on stderr).
    """
    import argparse

    parser = argparse.ArgumentParser(
        prog="rerun-importer-pfslam",
        description=f"Lets Rerun open recordings of pfslam-viz: {formats.in_words(', ')}; or a folder of one."
        " Writes a Rerun recording to standard output; the viewer calls it.",
    )
    parser.add_argument("path", type=Path, help="the file or folder that the viewer was asked to open")
    parser.add_argument("--application-id", help="what the viewer would call the application")
    parser.add_argument("--recording-id", help="the recording that the viewer made for this path")
    parser.add_argument("--config", help="name or path of a configuration; the recording's own by default")
    given, _ = parser.parse_known_args(arguments)  # viewers pass more, and newer ones may pass more still
    if _opened_as_folder(given.path, given.application_id):
        return 0  # the folder's replay has it already; refused by everybody, it would be reported as an error
    if not may_be_ours(given.path):
        return NOT_OURS
    from pfslam_viz.errors import PfslamError
    from pfslam_viz.recordings.catalog import is_recording
    from pfslam_viz.viewer.stdout_pipe import when_unread

    if not is_recording(given.path):
        return NOT_OURS
    when_unread(_leave)
    try:
        _replay(given.path, given.application_id, given.recording_id, given.config)
    except PfslamError as error:
        print(f"rerun-importer-pfslam: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        return 130
    return 0


def may_be_ours(path: Path) -> bool:
    """Whether the name alone, or a look at what a folder holds, speaks for it. Imports nothing heavy."""
    return any(row.claims_to_open(path) for row in formats.FORMATS)


def _opened_as_folder(path: Path, application: str | None) -> bool:
    """Whether the viewer is opening a recording's folder, which it hands over whole, and has come to a file in it."""
    if application is None or application == path.name.split(".")[0]:
        return False
    above = [folder for folder in path.resolve().parents[:3] if folder.name == application]
    return any(row.claims(path) and row.claims_folder(folder) for row in formats.FORMATS for folder in above)


def _replay(path: Path, application: str | None, recording_id: str | None, config_name: str | None) -> None:
    from pfslam_viz.api import run
    from pfslam_viz.config import load_config
    from pfslam_viz.recordings.catalog import load_recording
    from pfslam_viz.viewer.sinks import APPLICATION_ID, open_sinks
    from pfslam_viz.viewer.stream import replay_stream

    recording = load_recording(path)
    config = load_config(config_name or "default")
    with open_sinks(stdout=True, application_id=application or APPLICATION_ID, recording_id=recording_id) as sink:
        stream = replay_stream(recording, config, sink)
        stream.finish(run(recording, config, on_step=stream.log))


def _leave() -> None:
    """The viewer was closed: end at once, whatever is going on; nothing is kept but what it was sent."""
    with suppress(OSError):
        os.write(2, b"rerun-importer-pfslam: the viewer has gone: the run has ended\n")
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
