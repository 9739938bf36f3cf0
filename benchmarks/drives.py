"""Simulated drives whose wheels slip and whose gyro is off: how far the default filter is off, and whether it knows.

python -m benchmarks drives --seeds 20 --scratch DIR

Office, ring and hallway, each with so many seeds; wheels off by up to 10 %, slip up to 0.2, a gyro's bias up to 0.02
rad/s, drawn by the seed. Columns: rmse of position m while driving and in hindsight, and the normalised estimation
error squared, e' P^-1 e with the estimate's mean and covariance at every scan (Bar-Shalom, Li & Kirubarajan 2001), in
the mean over the drive: 3 where the covariance P is true, more where it is too small.
"""

import argparse
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config, load_config
from pfslam_viz.evaluation.trajectory_error import trajectory_error
from pfslam_viz.recordings.catalog import load_recording
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay
from pfslam_viz.simulation.recording import simulate

Array = NDArray[np.float64]

BUILDINGS = ("office", "ring", "hallway")
FIRST_SEED = 100  # of the buildings; those of the yardstick and the tests are below


def main(arguments: list[str]) -> None:
    """Print a row a drive as soon as it is done, then medians and worst."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks drives", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--seeds", type=int, default=20, help="drives a building")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument("--scratch", type=Path, help="folder to keep the recordings in")
    parser.add_argument("--set", action="append", default=[], help="section.key=value on top of the default")
    given = parser.parse_args(arguments)
    config = load_config("default", given.set)
    print("| drive | wheels | slip | gyro rad/s | online m | settled m | NEES |", "| --- " * 7 + "|", sep="\n")
    rows = []
    with ExitStack() as stack:
        scratch = given.scratch or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for seed in range(given.first, given.first + given.seeds):
            for building in BUILDINGS:
                errors = drawn(building, seed)
                numbers = drive(recording(scratch, building, seed, errors), config)
                rows.append(numbers)
                told = (f"{errors['wheel_scale']:g}", f"{errors['slip']:g}", f"{errors['gyro_bias']:g}")
                scored = (f"{numbers[0]:.3f}", f"{numbers[1]:.4f}", f"{numbers[2]:.1f}")
                print("| " + " | ".join([f"{building} {FIRST_SEED + seed}", *told, *scored]) + " |", flush=True)
    online, settled, nees = np.array(rows).T
    near = np.mean(settled <= 0.1)
    print(
        f"\nonline: median {np.median(online):.3f}, worst {online.max():.3f} m"
        f"\nsettled: median {np.median(settled):.4f}, worst {settled.max():.3f} m; {near:.0%} within 0.1 m"
        f"\nNEES: mean {nees.mean():.1f}, median {np.median(nees):.1f}, worst {nees.max():.1f}"
    )


def drawn(building: str, seed: int) -> dict[str, float]:
    """What the wheels and the gyro are off by in one drive."""
    rng = np.random.default_rng([seed, BUILDINGS.index(building)])
    scale, slip, bias = rng.uniform(0.9, 1.1), rng.uniform(0.0, 0.2), rng.uniform(0.0, 0.02)
    return {"wheel_scale": round(scale, 3), "slip": round(slip, 3), "gyro_bias": round(bias, 4)}


def recording(scratch: Path, building: str, seed: int, errors: dict[str, float]) -> Recording:
    """The simulated drive, made into ``scratch`` if it is not there yet."""
    path = scratch / f"d-{building}-{seed}"
    if not path.is_dir():
        simulate(
            path,
            frames=False,
            building=building,
            seed=FIRST_SEED + seed,
            wheel_scale=errors["wheel_scale"],
            slip=errors["slip"],
            gyro_bias=errors["gyro_bias"],
        )
    return load_recording(str(path))


def drive(recording: Recording, config: Config) -> tuple[float, float, float]:
    """Rmse of position while driving and in hindsight, m, and the mean normalised estimation error squared."""
    assert recording.truth is not None
    replay = Replay(recording, config, texture=False)
    means, covariances = [], []
    for step in replay:
        means.append(step.estimate.mean)
        covariances.append(step.estimate.covariance)
    result = replay.result()
    truth = recording.truth.at(result.stamps)
    squares = normalised_squares(geometry.between(truth[:1], truth), np.array(means), np.array(covariances))
    return (
        trajectory_error(truth, result.online).position_rmse,
        trajectory_error(truth, result.estimate).position_rmse,
        float(squares.mean()),
    )


def normalised_squares(truth: Array, means: Array, covariances: Array) -> Array:
    """(n,) e' P^-1 e of the errors e (n, 3) of ``means`` by their ``covariances`` (n, 3, 3)."""
    errors = means - truth
    errors[:, 2] = geometry.wrap(errors[:, 2])
    squares: Array = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    return squares
