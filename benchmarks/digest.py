"""``python -m benchmarks digest``: what short drives come to, bit for bit, in a few letters.

The same on every run, with any number of threads, with and without a viewer; compare what two machines, or two
versions of Python, NumPy or numba, print.
"""

import argparse
import hashlib
import platform
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import pfslam_viz as pf
from pfslam_viz.simulation.recording import simulate

CONFIGS = ("paper", "default")
SECONDS = 20.0


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks digest", description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--save", action="store_true", help="write a recording file meanwhile")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        drive = short_drive(Path(folder) / "drive")
        print(f"{'recording':10} {of(drive.ranges, drive.odometry, drive.stamps)}")
        for name in CONFIGS:
            destinations = {"save": Path(folder) / f"{name}.rrd"} if chosen.save else {}
            print(f"{name:10} {of_run(drive, name, chosen.threads, **destinations)}")
    print(f"(Python {platform.python_version()}, NumPy {np.__version__}, {chosen.threads} threads)")


def short_drive(folder: Path, seconds: float = SECONDS) -> pf.Recording:
    """A simulated drive through an office, without a camera."""
    simulate(folder, seed=3, duration=seconds, frames=False)
    return pf.load_recording(folder)


def of_run(recording: pf.Recording, config: str, threads: int | None, **destinations: Any) -> str:
    """The digest of all that a run tells: of every scan the whole belief, at the end trajectories and maps.

    ``destinations`` are what :func:`~pfslam_viz.viewer.sinks.open_sinks` takes; without any, nothing is logged.
    """
    digest = hashlib.sha256()
    settings = pf.load_config(config)
    replay = pf.Replay(recording, settings, threads=threads)
    with _stream(recording, settings, destinations) as log:
        for step in replay:
            log(step)
            belief = step.estimate
            for array in (belief.particles, belief.weights, belief.mean, belief.covariance, step.end_points):
                digest.update(np.ascontiguousarray(array).tobytes())
        result = replay.result()
    grids = (result.grid.log_odds, result.dead_reckoning_grid.log_odds)
    digest.update(of(result.estimate, result.online, *grids).encode())
    return digest.hexdigest()[:16]


def of(*arrays: np.ndarray) -> str:
    """The beginning of the SHA-256 of the arrays' bytes."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


@contextmanager
def _stream(
    recording: pf.Recording, config: pf.Config, destinations: dict[str, Any]
) -> Iterator[Callable[[pf.Step], None]]:
    """What a Step is logged with."""
    if not destinations:
        yield lambda step: None
        return
    from pfslam_viz.viewer.sinks import open_sinks
    from pfslam_viz.viewer.stream import replay_stream

    with open_sinks(**destinations) as sink:
        yield replay_stream(recording, config, sink).log
