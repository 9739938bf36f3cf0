"""Interactive replay of particle-filter SLAM in the Rerun viewer.

Importing this package imports nothing heavy: every command brings in what it needs, and so does every name below when
it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pfslam_viz.api import run, save
    from pfslam_viz.config import Config, load_config
    from pfslam_viz.errors import InputError, PfslamError
    from pfslam_viz.recordings.catalog import load_recording
    from pfslam_viz.recordings.recording import Recording
    from pfslam_viz.replay import Replay, Result
    from pfslam_viz.step import Step

__version__ = "0.2.0"

__all__ = [
    "Config",
    "InputError",
    "PfslamError",
    "Recording",
    "Replay",
    "Result",
    "Step",
    "__version__",
    "load_config",
    "load_recording",
    "run",
    "save",
]

_HOMES = {
    "Config": "pfslam_viz.config",
    "InputError": "pfslam_viz.errors",
    "PfslamError": "pfslam_viz.errors",
    "Recording": "pfslam_viz.recordings.recording",
    "Replay": "pfslam_viz.replay",
    "Result": "pfslam_viz.replay",
    "Step": "pfslam_viz.step",
    "load_config": "pfslam_viz.config",
    "load_recording": "pfslam_viz.recordings.catalog",
    "run": "pfslam_viz.api",
    "save": "pfslam_viz.api",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
