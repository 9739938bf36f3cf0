"""What every command that runs the filter shows meanwhile: that kernels are loaded or compiled, and a progress bar."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from pfslam_viz import console
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.slam import loading

COMPILING = "compiling kernels (first run on this machine)"


def load_kernels(quiet: bool = False) -> None:
    """Compile the filter's kernels or load them from the cache, and say so."""
    with console.status("loading kernels", quiet):
        loading.load_kernels(_on_compile(quiet))


@contextmanager
def replay_progress(
    recording: Recording, quiet: bool = False, label: str = "replay", runs: int = 1
) -> Iterator[console.ReplayProgress]:
    """The progress bar of ``runs`` runs over the recording, which also says if more kernels have to be compiled."""
    scans, duration = runs * len(recording), runs * recording.duration
    with loading.announced(_on_compile(quiet)), console.ReplayProgress(scans, duration, quiet, label) as bar:
        yield bar


def _on_compile(quiet: bool) -> Callable[[], None]:
    return (lambda: None) if quiet else _say_compiling


@cache
def _say_compiling() -> None:
    """Once a run, however many kernels there are."""
    console.tell(COMPILING)
