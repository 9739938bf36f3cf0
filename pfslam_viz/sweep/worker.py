"""What a worker does: it has recordings, runs cells over them, and sends back rows."""

import hashlib
import io
import signal
from dataclasses import dataclass, fields, replace
from time import perf_counter
from typing import Any

import numpy as np

from pfslam_viz.config import Config
from pfslam_viz.errors import PfslamError
from pfslam_viz.evaluation.cell import run_cell, warm_up
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result
from pfslam_viz.slam.backends import BACKENDS
from pfslam_viz.sweep.row import Row, numbers, provenance
from pfslam_viz.sweep.trace import pack
from pfslam_viz.sweep.version import code_version

_RECORDINGS: dict[str, Recording] = {}  # by fingerprint, for as long as the process runs
_LOADED: set[str] = set()  # kinds whose kernels are loaded


@dataclass(frozen=True, slots=True)
class Order:
    """One cell as it is sent: ``choice`` is where the recording lies, ``config`` all settings with the seed."""

    cell: str
    fingerprint: str
    choice: RecordingChoice
    config: dict[str, Any]
    code: str


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of an order: numbers and trace, or what went wrong.

    ``lacks`` is set where the worker has no such recording, ``code`` is the worker's own version.
    """

    cell: str
    code: str
    row: Row
    trace: bytes = b""
    error: str | None = None
    lacks: bool = False


def run_order(order: Order) -> Answer:
    """Run one cell. Whatever goes wrong in it is said in the answer: one bad cell must not end a sweep."""
    code = code_version()
    if code != order.code:
        return Answer(order.cell, code, {})
    try:
        recording = _recording(order)
        if recording is None:
            return Answer(order.cell, code, {}, lacks=True)
        load_kernels(recording, [order.config])
        started = perf_counter()
        result, scores = run_cell(recording, _config(order.config), threads=1)
        row = numbers(scores) | {"cell_s": perf_counter() - started}
        return Answer(order.cell, code, row | provenance(), pack_result(result))
    except Exception as error:
        return Answer(order.cell, code, provenance(), error=one_line(error))


def receive(fingerprint: str, recording: Recording) -> None:
    """Keep a recording that was sent by content."""
    _RECORDINGS[fingerprint] = recording


def load_kernels(recording: Recording, configs: list[dict[str, Any]]) -> None:
    """Compile what these configurations need, or load it from the cache: once a process, and in no cell's time."""
    for config in map(_config, configs):
        if (what := kind(config)) not in _LOADED:
            warm_up(recording, config)
            _LOADED.add(what)


def kind(config: Config) -> str:
    """The same for configurations that run the same kernels: those that differ in numbers alone."""
    return repr(_choices(config.model_dump(mode="json", exclude={"name"})))


def fingerprint(recording: Recording) -> str:
    """A digest of all of a recording that an estimate or a score depends on."""
    digest = hashlib.sha256()
    lidar, truth, relations = recording.lidar, recording.truth, recording.relations
    arrays: list[Any] = [recording.stamps, recording.ranges, recording.odometry, recording.odometry_known]
    arrays += [recording.beam_times, *(getattr(lidar, f.name) for f in fields(lidar))]
    arrays += [None, None] if truth is None else [truth.stamps, truth.poses]
    arrays += [None] if relations is None else [relations.start, relations.end, relations.poses]
    for array in arrays:
        value = np.ascontiguousarray(np.zeros(0) if array is None else array)
        digest.update(f"{value.dtype.str}{value.shape}".encode() + value.tobytes())
    return digest.hexdigest()[:16]


def content(recording: Recording) -> Recording:
    """What is sent of a recording: all but the camera's images and the single sensors' stamps, which no cell reads."""
    return replace(recording, frames=None, streams=())


def one_line(error: BaseException) -> str:
    """An error as a row has it."""
    text = " ".join(str(error).split())
    return text if isinstance(error, PfslamError) else f"{type(error).__name__}: {text}"


def pack_result(result: Result) -> bytes:
    """The result's trajectory and map as the bytes of an .npz."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **pack(result))
    return buffer.getvalue()


def dask_setup(worker: object) -> None:
    """Dask calls this as a local worker starts: Ctrl-C is the command's to handle, which ends its workers in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _config(values: dict[str, Any]) -> Config:
    config: Config = BACKENDS[values["backend"]].settings.model_validate(values)
    return config


def _choices(value: Any) -> Any:
    """What of the settings is no number: it decides which kernels run."""
    if isinstance(value, dict):
        return {key: _choices(inner) for key, inner in value.items()}
    return value if isinstance(value, str | bool) else None


def _recording(order: Order) -> Recording | None:
    """The recording, kept from before or read from its path; None where there is none, or another one."""
    if order.fingerprint not in _RECORDINGS:
        try:
            found = order.choice.load()
        except PfslamError:
            return None
        if fingerprint(found) != order.fingerprint:
            return None
        _RECORDINGS[order.fingerprint] = content(found)
    return _RECORDINGS[order.fingerprint]
