"""The numbers of one run, as plain JSON: what ``metrics.json`` holds and the summary shows."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from platform import python_version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import __version__, geometry
from pfslam_viz.evaluation.map_quality import end_to_start_gap
from pfslam_viz.evaluation.relations import relation_errors
from pfslam_viz.evaluation.trajectory_error import trajectory_error
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result

Array = NDArray[np.float64]

LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "rerun-sdk")


def metrics(result: Result) -> dict[str, Any]:
    """Everything there is to say of a run; JSON-able, and what is not known or not finite is ``None``.

    Lengths are in m, angles in deg, times in s or ms, as the names say. ``truth`` and ``relations`` score the final
    trajectory (``estimate``), the poses as they were estimated at the time (``online``) and ``dead_reckoning``.
    ``kept`` is which trajectory the final one is, if there was a choice: see :class:`pfslam_viz.slam.protocol.Kept`.
    """
    trajectories = {
        "estimate": result.estimate,
        "online": result.online,
        "dead_reckoning": result.dead_reckoning,
    }
    recording = result.recording
    scored = {
        name: scores(recording, result.stamps, poses, result.truth) if len(poses) else {}
        for name, poses in trajectories.items()
    }
    values: dict[str, Any] = {
        "recording": {
            "name": recording.name,
            "format": recording.format,
            "scans": len(recording),
            "duration_s": recording.duration if len(recording) else 0.0,
            "notes": list(recording.notes),
        },
        "findings": [finding.as_dict() for finding in recording.findings],
        "scans": len(result.stamps),
        "interrupted": result.interrupted,
        "seed": result.config.seed,
        "config": result.config.model_dump(mode="json"),
        "versions": versions(),
        "path_length_m": {name: geometry.path_length(poses) for name, poses in trajectories.items()},
        "end_to_start_gap_m": {
            name: end_to_start_gap(poses) if len(poses) else None for name, poses in trajectories.items()
        },
        "truth": {name: s["truth"] for name, s in scored.items() if "truth" in s} or None,
        "relations": {name: s["relations"] for name, s in scored.items() if "relations" in s} or None,
        "kept": None if result.kept is None else asdict(result.kept),
        "resamplings": result.resamplings,
        "uninformative": result.uninformative,
        "frames": _frames(result),
        "camera": _camera(result),
        "speed": speed(result),
    }
    plain: dict[str, Any] = finite(values)
    return plain


def scores(recording: Recording, stamps: Array, poses: Array, truth: Array | None) -> dict[str, dict[str, float]]:
    """``poses`` (n, 3) at ``stamps`` (n,) s against whatever is known: ``truth`` (n, 3), the recording's relations."""
    out: dict[str, dict[str, float]] = {}
    if truth is not None:
        out["truth"] = trajectory_error(truth, poses).as_dict()
    if recording.relations is not None:
        errors = relation_errors(recording.relations, stamps, poses)
        if errors is not None:
            out["relations"] = errors.as_dict()
    return out


def speed(result: Result) -> dict[str, Any]:
    """Time per phase and overall, settling the run included; times real time is the recording's time over that."""
    phases = {
        phase: {
            "median_ms": float(np.median(seconds)) * 1e3,
            "p95_ms": float(np.percentile(seconds, 95)) * 1e3,
            "total_s": float(seconds.sum()),
        }
        for phase, seconds in result.seconds.items()
        if len(seconds)
    }
    total = sum(phase["total_s"] for phase in phases.values()) + result.finish_seconds
    scans = len(result.stamps)
    recorded = float(result.stamps[-1] - result.stamps[0]) if scans else 0.0
    return {
        "phases": phases,
        "finish_s": result.finish_seconds,
        "compile_s": result.compile_seconds,  # in none of the others
        "total_s": total,
        "ms_per_scan": 1e3 * total / scans if scans else None,
        "scans_per_second": scans / total if total > 0 else None,
        "times_real_time": recorded / total if total > 0 else None,
    }


def _frames(result: Result) -> dict[str, int] | None:
    """How many camera frames are in the floor texture, and how many are not, by reason; None without a texture."""
    if result.texture is None:
        return None
    skipped = {} if result.skipped_frames is None else asdict(result.skipped_frames)
    return {"painted": result.texture.frames, **skipped}


def _camera(result: Result) -> dict[str, Any] | None:
    """The camera, and how many frames were painted with a plane of their own; None without a texture."""
    if result.camera is None:
        return None
    return {**result.camera.as_dict(), "own_plane_frames": result.texture.tilted if result.texture else 0}


def versions() -> dict[str, str]:
    """Of this package, of Python, and of the libraries that a result may depend on."""
    found = {"pfslam-viz": __version__, "python": python_version()}
    for library in LIBRARIES:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            continue
    return found


def finite(value: Any) -> Any:
    """The same tree of mappings, sequences and scalars, with ``None`` for NaN and infinity and no NumPy scalars."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, np.ndarray):
        return finite(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
