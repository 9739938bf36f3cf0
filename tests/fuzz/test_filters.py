"""Any recording that is accepted is replayed to its end, under any settings, and all that comes out is sound."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rerun.chunk import RrdReader

import pfslam_viz as pf
from pfslam_viz.evaluation.metrics import metrics
from pfslam_viz.export import export
from pfslam_viz.recordings.checking.check import check
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.viewer.sinks import open_sinks
from pfslam_viz.viewer.stream import replay_stream

Array = NDArray[np.float64]

NO_NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-30)


@st.composite
def recordings(draw: st.DrawFn) -> pf.Recording:
    """Recordings of a few scans: rooms, noise, nothing; stamps, odometry and lidars of every sort, some broken."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scans, beams = draw(st.integers(1, 14)), draw(st.integers(1, 40))
    range_max = draw(st.sampled_from([0.3, 4.0, 30.0, 80.0]))
    angles = np.linspace(-0.5, 0.5, beams) * draw(st.sampled_from([0.0, 1.0, 4.7, 2 * np.pi, -np.pi]))
    shape = (scans, beams)
    ranges = {
        "noise": rng.uniform(0.0, 1.2 * range_max, shape),
        "room": np.full(shape, 0.5 * range_max),
        "walls": np.tile(rng.uniform(0.1, 1.0, beams) * range_max, (scans, 1)) + rng.normal(0, 0.02, shape),
        "nothing": np.zeros(shape),
        "farthest": np.full(shape, range_max),
    }[draw(st.sampled_from(["noise", "room", "walls", "nothing", "farthest"]))]
    declared = draw(st.integers(0, 3)) > 0
    strange = [*NO_NUMBERS, range_max, 1e30 if declared else np.nextafter(range_max, 1e9)]
    broken = rng.random(shape) < draw(st.sampled_from([0.0, 0.1, 1.0]))
    ranges = np.where(broken, rng.choice(strange, shape), ranges)
    step = draw(st.sampled_from([1e-6, 0.025, 1.0, 3600.0]))
    stamps = draw(st.sampled_from([0.0, -5.0, 1.3e9])) + step * (np.arange(scans) + rng.uniform(0, 0.9, scans))
    if draw(st.booleans()):
        stamps = rng.choice(stamps, scans)  # repeated, backwards
    size = draw(st.sampled_from([0.0, 1e-9, 0.02, 0.6, 8.0]))
    odometry = rng.normal(0.0, size, (scans, 3)) * [1.0, draw(st.sampled_from([0.0, 1.0])), 0.5]
    arguments: dict[str, Any] = {}
    if draw(st.booleans()):
        arguments["beam_times"] = np.linspace(0.0, draw(st.sampled_from([-0.1, 0.2])), beams)
    if draw(st.booleans()):
        arguments["truth"] = np.cumsum(odometry, axis=0)
    return pf.Recording.from_arrays(
        stamps,
        ranges,
        angles,
        odometry if draw(st.integers(0, 3)) else None,
        range_min=draw(st.sampled_from([0.0, 0.1])),
        range_max=range_max if declared else None,
        lidar_pose=draw(st.sampled_from([(0.0, 0.0, 0.0), (0.3, -0.1, 3.0)])),
        **arguments,
    )


@st.composite
def choices(draw: st.DrawFn) -> tuple[str, tuple[str, ...]]:
    """Either filter by its name, with settings that decide which paths of it are taken."""
    name = draw(st.sampled_from(["paper", "default"]))
    said = {
        "particles": draw(st.integers(1, 12)),
        "seed": draw(st.integers(0, 99)),
        "map.cell": draw(st.sampled_from([0.05, 0.2, 1.0])),
        "map.log_odds_bound": draw(st.sampled_from([0.5, 4.0])),
        "resampling.policy": draw(st.sampled_from(["always", "n_eff"])),
        "resampling.scheme": draw(st.sampled_from(["multinomial", "systematic", "stratified", "residual"])),
        "observation.max_beams": draw(st.sampled_from([1, 7, 1000])),
    }
    if name == "paper":
        said["observation.model"] = draw(st.sampled_from(["correlation", "likelihood_field"]))
        said["motion.model"] = draw(st.sampled_from(["additive", "scaled"]))
    else:
        said["rao_blackwellized.update_distance"] = draw(st.sampled_from([0.01, 0.5]))
    return name, tuple(f"{key}={value}" for key, value in said.items())


def sound(step: pf.Step, config: pf.Config) -> None:
    """What holds after every scan."""
    belief = step.estimate
    n = config.particles
    assert belief.particles.shape == (n, 3) and belief.weights.shape == (n,) and belief.parents.shape == (n,)
    for value in (belief.particles, belief.weights, belief.best, belief.mean, belief.covariance, step.dead_reckoning):
        assert np.isfinite(value).all()
    assert (belief.weights >= 0).all() and belief.weights.sum() == pytest.approx(1.0, abs=1e-9)
    assert 1.0 - 1e-9 <= belief.n_eff <= n * (1 + 1e-9)
    assert ((belief.parents >= 0) & (belief.parents < n)).all()
    assert (np.abs(belief.particles[:, 2]) <= np.pi + 1e-9).all() and abs(belief.mean[2]) <= np.pi + 1e-9
    assert np.linalg.eigvalsh(belief.covariance).min() >= -1e-6 * (1 + np.abs(belief.covariance).max())
    assert np.isfinite(step.end_points).all() and len(step.hits) == len(step.end_points)
    for grid in (step.grid, step.dead_reckoning_grid):
        bounded(grid, config)


def bounded(grid: OccupancyGrid, config: pf.Config) -> None:
    """Log-odds are within their bounds, and the occupied cells are those above the threshold."""
    log_odds = grid.log_odds
    assert np.isfinite(log_odds).all()
    assert np.abs(log_odds).max(initial=0.0) <= config.map.log_odds_bound + 1e-4
    np.testing.assert_array_equal(grid.occupied > 0, log_odds > config.map.threshold)


def read_back(folder: Path, result: pf.Result) -> None:
    """The exported files hold what the run came to."""
    for name, poses in (("estimate", result.estimate), ("online", result.online), ("truth", result.truth)):
        if poses is None:
            assert not (folder / f"{name}.tum").exists()
            continue
        rows = np.loadtxt(folder / f"{name}.tum", ndmin=2)
        assert rows.shape == (len(poses), 8) and np.isfinite(rows).all()
        np.testing.assert_allclose(rows[:, 0], result.stamps, rtol=0, atol=1e-5)
        np.testing.assert_allclose(rows[:, 1:3], poses[:, :2], atol=1e-5)
        np.testing.assert_allclose(
            2 * np.arctan2(rows[:, 6], rows[:, 7]) % (2 * np.pi), poses[:, 2] % (2 * np.pi), atol=1e-5
        )
    header, size, depth, pixels = (folder / "map.pgm").read_bytes().split(b"\n", 3)
    columns, lines = map(int, size.split())
    assert (header, depth, len(pixels)) == (b"P5", b"255", columns * lines)


def all_finite(path: Path) -> None:
    """Every number of a recording file is one."""
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            while pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type):
                column = column.flatten()
            if pa.types.is_floating(column.type):
                values = column.drop_null().to_numpy(zero_copy_only=False)
                assert np.isfinite(values).all(), f"{chunk.entity_path}: {name}"


@given(recording=recordings(), choice=choices())
@settings(max_examples=25)
def test_every_recording_is_replayed_to_its_end(
    recording: pf.Recording, choice: tuple[str, tuple[str, ...]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    config = pf.load_config(*choice)
    checked = check(recording)
    folder = tmp_path_factory.mktemp("run")
    path = folder / "run.rrd"
    replay = pf.Replay(checked, config, threads=2)
    with open_sinks(save=path) as sink:
        stream = replay_stream(replay.recording, config, sink)
        for step in replay:
            sound(step, config)
            stream.log(step)
        result = replay.result()
        stream.finish(result)
    assert len(result.stamps) == len(checked) and not result.interrupted
    assert np.isfinite(result.estimate).all() and result.estimate.shape == (len(checked), 3)
    bounded(result.grid, config)
    export(result, folder, metrics(result))
    read_back(folder, result)
    all_finite(path)
