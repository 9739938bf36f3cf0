"""One configuration over many kinds of recordings: how far off it is while driving ("online") and in hindsight.

python -m benchmarks yardstick --data DIR --scratch DIR --seeds 3
python -m benchmarks yardstick --data DIR --only thinned --seeds 5 --set loop_closing.enabled=false
python -m benchmarks yardstick --data DIR --only thinned --good-odometry --set rao_blackwellized.max_range=5.0

Where the truth or a reference is known, the error is the rmse of position with the first poses laid over each other
("shape" is that of the settled trajectory after the best rigid fit: references of real drives have first poses that are
wrong, too); where relations are known, it is their mean |translation| (Kümmerle et al. 2009). All in m.
A recording that is not in --data is left out. Simulated ones are made into --scratch, once.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config, load_config
from pfslam_viz.evaluation.relations import relation_errors
from pfslam_viz.evaluation.trajectory_error import trajectory_error
from pfslam_viz.recordings.recording import Recording, Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Entry:
    """A recording of the yardstick: its label, its file or folder under --data, or what to simulate."""

    label: str
    path: str = ""
    reference: str = ""  # npz or TUM beside it, where the recording does not bring its own truth or relations
    simulated: tuple[tuple[str, Any], ...] = ()


def simulated(building: str, seed: int, **errors: float) -> Entry:
    """A drive through one building, with the wheels and the gyro off by ``errors``."""
    said = " ".join(f"{name.replace('wheel_', '')} {value:g}" for name, value in errors.items())
    return Entry(f"{building} {seed} {said}", simulated=(("building", building), ("seed", seed), *errors.items()))


THINNED = ("edmonton", "orebro", "fhw", "belgioioso", "freiburg-101", "seattle")
ENTRIES = (
    *(Entry(f"thinned/{n}", f"thinned/{n}.clf.bz2", f"thinned/{n}.reference.npz") for n in THINNED),
    *(
        Entry(f"case/{n}", f"cases/{n}/{n}.log", f"cases/{n}/truth.tum")
        for n in ("base", "stilldrift", "people2", "lds35", "sentinel8", "clockwise")
    ),
    Entry("case/n_base", "cases/n_base/Hokuyo21.npz", "cases/n_base/truth.tum"),
    simulated("hallway", 20, slip=0.2),
    simulated("ring", 14, wheel_scale=0.95, slip=0.05),
    simulated("ring", 19, wheel_scale=1.1, slip=0.1, gyro_bias=0.01),
    simulated("office", 15, wheel_scale=0.92, slip=0.15, gyro_bias=0.02),
    simulated("hallway", 4, wheel_scale=1.03),
    simulated("ring", 2, wheel_scale=1.03),
    Entry("twin21", "twin21/Hokuyo21.npz"),
    Entry("intel", "carmen/intel.clf.bz2"),
    Entry("fr079", "carmen/fr079.clf.bz2"),
)
UNSEEN = (  # not to be looked at while something is being changed
    simulated("office", 30, wheel_scale=1.08, slip=0.1, gyro_bias=0.01),
    simulated("office", 31, wheel_scale=0.9, slip=0.2, gyro_bias=0.02),
    simulated("office", 32, wheel_scale=1.02, slip=0.05),
    simulated("ring", 33, wheel_scale=0.9, slip=0.2, gyro_bias=0.02),
    simulated("ring", 34, wheel_scale=1.05, slip=0.1),
    simulated("ring", 35, wheel_scale=0.97, slip=0.02, gyro_bias=0.005),
    simulated("hallway", 36, wheel_scale=1.1, slip=0.2),
    simulated("hallway", 37, wheel_scale=0.95, slip=0.1, gyro_bias=0.02),
    simulated("hallway", 38, wheel_scale=1.03, slip=0.02),
)


@dataclass(frozen=True)
class Outcome:
    """One run: errors in m, which of the two trajectories was kept, closed loops, and times real time."""

    online: float
    settled: float
    shape: float
    kept: str
    closures: int
    speed: float


def main(arguments: list[str]) -> None:
    """Print a row for every recording as soon as it is done."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks yardstick", description=(__doc__ or "").split("\n\n")[0]
    )
    parser.add_argument("--data", type=Path, required=True, help="folder with thinned/, cases/, carmen/, twin21/")
    parser.add_argument("--scratch", type=Path, help="folder to keep simulated recordings in")
    parser.add_argument("--seeds", type=int, default=3, help="seeds 0, 1, ... of the filter")
    parser.add_argument("--only", action="append", help="part of a label; repeatable")
    parser.add_argument("--unseen", action="store_true", help="the recordings that are kept for the end")
    parser.add_argument(
        "--good-odometry",
        action="store_true",
        help="odometry that is nearly right, made of the truth where it is known",
    )
    parser.add_argument("--slips", type=int, default=0, help="turns of 0.05 to 0.25 rad that it errs by")
    parser.add_argument("--set", action="append", default=[], help="section.key=value on top of the default")
    parser.add_argument("--json", type=Path, help="write every number into this file")
    given = parser.parse_args(arguments)
    config = load_config("default", given.set)
    print(
        "| recording | online | settled | shape | kept | loops | x real time |",
        "| --- " * 7 + "|",
        sep="\n",
        flush=True,
    )
    numbers: dict[str, list[dict[str, Any]]] = {}
    with ExitStack() as stack:
        scratch = given.scratch or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for entry in UNSEEN if given.unseen else ENTRIES:
            if given.only and not any(part in entry.label for part in given.only):
                continue
            recording = load(entry, given.data, scratch)
            if recording is None:
                print(f"{entry.label}: not in {given.data}", file=sys.stderr)
                continue
            if given.good_odometry:
                recording = with_good_odometry(recording, given.slips)
            outcomes = [run(recording, config, seed) for seed in range(given.seeds)]
            print(row(entry.label, outcomes), flush=True)
            numbers[entry.label] = [vars(outcome) for outcome in outcomes]
            if given.json:
                given.json.write_text(json.dumps(numbers, indent=1))


def load(entry: Entry, data: Path, scratch: Path) -> Recording | None:
    """The recording with whatever is known of the truth; None if it is not there."""
    from pfslam_viz.recordings.catalog import load_recording
    from pfslam_viz.simulation.recording import simulate

    if entry.simulated:
        path = scratch / entry.label.replace(" ", "-")
        if not path.is_dir():
            simulate(path, frames=False, **dict(entry.simulated))
    else:
        path = data / entry.path
        if not path.exists():
            return None
    recording = load_recording(str(path))
    if entry.reference:
        recording = replace(recording, truth=reference(data / entry.reference))
    return recording


def with_good_odometry(recording: Recording, slips: int = 0) -> Recording:
    """The same with the true motions as odometry, off by 0.5 % of the way, 0.2 % of a turn and 0.6 mrad per √m.

    And by 0.05 to 0.25 rad at so many scans, where wheels are taken to have slipped.
    """
    if recording.truth is None:
        return recording
    rng = np.random.default_rng(7)
    poses = recording.truth.at(recording.stamps)
    steps = np.vstack([np.zeros(3), geometry.between(poses[:-1], poses[1:])])
    driven = np.hypot(steps[:, 0], steps[:, 1])
    steps[:, :2] *= rng.normal(1.0, 0.005, len(steps))[:, None]
    steps[:, 2] += rng.standard_normal(len(steps)) * (0.002 * np.abs(steps[:, 2]) + 0.0006 * np.sqrt(driven))
    moving = np.flatnonzero(driven > 1e-4)
    slipped = rng.choice(moving, slips, replace=False)
    steps[slipped, 2] += rng.choice([-1.0, 1.0], slips) * rng.uniform(0.05, 0.25, slips)
    return replace(recording, odometry=steps, odometry_known=None)


def reference(path: Path) -> Trajectory:
    """True poses of an npz (``stamps``, ``pose``) or a TUM file."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return Trajectory(arrays["stamps"], arrays["pose"])
    table = np.loadtxt(path, ndmin=2)
    heading = 2.0 * np.arctan2(table[:, 6], table[:, 7])
    return Trajectory(table[:, 0], np.column_stack([table[:, 1:3], heading]))


def run(recording: Recording, config: Config, seed: int) -> Outcome:
    """Replay it without a viewer, and score both trajectories."""
    from pfslam_viz.replay import Replay

    replay = Replay(recording, config.model_copy(update={"seed": seed}), texture=False)
    started = perf_counter()
    for _ in replay:
        pass
    seconds = perf_counter() - started
    result = replay.result()
    return Outcome(
        error(recording, result.stamps, result.online),
        error(recording, result.stamps, result.estimate),
        shape_error(recording, result.stamps, result.estimate),
        "-" if result.kept is None else f"{result.kept.trajectory} {result.kept.sigmas:.1f}",
        len(result.closures),
        recording.duration / seconds,
    )


def error(recording: Recording, stamps: Array, poses: Array) -> float:
    """Rmse of position, or the mean error of relations, m."""
    if recording.truth is not None:
        return trajectory_error(recording.truth.at(stamps), poses).position_rmse
    if recording.relations is None:
        return float("nan")
    errors = relation_errors(recording.relations, stamps, poses)
    return float("nan") if errors is None else errors.translation.mean


def shape_error(recording: Recording, stamps: Array, poses: Array) -> float:
    """Rmse of position after the best rigid fit (Umeyama 1991), m; nan without truth."""
    if recording.truth is None:
        return float("nan")
    a, b = recording.truth.at(stamps)[:, :2], poses[:, :2]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1.0, np.linalg.det(u @ v)]) @ v
    return float(np.sqrt(((a - b @ turn) ** 2).sum(axis=1).mean()))


def row(label: str, outcomes: list[Outcome]) -> str:
    """A Markdown row: every seed, none left out."""

    def each(values: Iterator[str]) -> str:
        return ", ".join(values)

    cells = (
        label,
        each(f"{o.online:.3f}" for o in outcomes),
        each(f"{o.settled:.4f}" for o in outcomes),
        each(f"{o.shape:.3f}" for o in outcomes),
        each(o.kept for o in outcomes),
        each(str(o.closures) for o in outcomes),
        each(f"{o.speed:.0f}" for o in outcomes),
    )
    return "| " + " | ".join(cells) + " |"
