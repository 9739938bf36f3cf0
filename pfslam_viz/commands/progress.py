"""What every command that runs the filter shows meanwhile: how far kernels are compiled, and how far the run is."""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache

from pfslam_viz import console
from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.slam import loading

COMPILING = "compiling kernels (first run on this machine)"


@contextmanager
def kernels(
    configs: Sequence[Config], recording: Recording | None = None, *, viewer: bool = False, quiet: bool = False
) -> Iterator[None]:
    """Load the kernels that runs under these configurations call, or compile them, with progress.

    For a ``recording``, also those that paint its floor, if it has images; for a ``viewer``, those that draw for it.
    What is needed some way into a run is compiled beside what is done in the context.
    """
    from pfslam_viz.compiling import cache
    from pfslam_viz.compiling.compile import compiling
    from pfslam_viz.compiling.needed import needed

    texture = recording is not None and recording.frames is not None
    if not cache.use_cache() and not quiet:
        console.tell(cache.where())
    with ExitStack() as stack:
        with console.steps("compiling", quiet) as show:
            wanted = needed(configs, viewer=viewer, texture=texture)
            if stack.enter_context(compiling(wanted, show, console.tell)):
                gc.freeze()  # what numba leaves is not walked while the filter runs
        yield


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
