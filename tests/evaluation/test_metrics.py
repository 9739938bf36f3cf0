"""The numbers of one run, from a hand-made result."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz.config import Config
from pfslam_viz.evaluation.metrics import finite, metrics
from pfslam_viz.recordings.recording import Lidar, Recording, Relations
from pfslam_viz.replay import Result
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import Kept


def make_result(n: int = 5) -> Result:
    """A straight drive of 4 m in 8 s, of which the first n scans were done; the estimate ends 0.2 m to the side."""
    odometry = np.tile([1.0, 0, 0], (5, 1))
    odometry[0] = 0
    relations = Relations(np.array([0.0, 4.0]), np.array([8.0, 8.0]), np.array([[4.0, 0, 0], [2.0, 0.2, 0]]))
    recording = Recording(
        name="straight",
        format="test",
        path=Path("straight"),
        stamps=np.arange(5.0) * 2.0,
        ranges=np.zeros((5, 1), np.float32),
        lidar=Lidar(np.zeros(1), 0.1, 30, np.zeros(3)),
        odometry=odometry,
        relations=relations,
        notes=("one scan was late",),
    )
    truth = recording.dead_reckoning()
    estimate = truth.copy()
    estimate[4, 1] = 0.2
    config = Config(seed=7)
    return Result(
        recording=recording,
        config=config,
        stamps=recording.stamps[:n],
        estimate=estimate[:n],
        online=truth[:n].copy(),
        dead_reckoning=truth[:n],
        truth=truth[:n],
        grid=OccupancyGrid(config.map),
        dead_reckoning_grid=OccupancyGrid(config.map),
        seconds={"predict": np.array([0.001, 0.001, 0.002, 0.004, 0.002])[:n], "map": np.full(5, 0.002)[:n]},
        resamplings=3,
        uninformative=1,
        interrupted=n < 5,
    )


def test_numbers_by_hand() -> None:
    m = metrics(make_result())
    assert m["path_length_m"]["dead_reckoning"] == pytest.approx(4.0)
    assert m["path_length_m"]["estimate"] == pytest.approx(3 + math.hypot(1, 0.2))
    assert m["end_to_start_gap_m"]["estimate"] == pytest.approx(math.hypot(4, 0.2))
    assert m["truth"]["estimate"]["position_rmse_m"] == pytest.approx(0.2 / math.sqrt(5))
    assert m["truth"]["online"]["position_max_m"] == 0.0
    assert m["relations"]["estimate"]["translation_mean_m"] == pytest.approx(0.1)
    assert m["relations"]["dead_reckoning"]["translation_mean_m"] == pytest.approx(0.1)
    assert (m["resamplings"], m["uninformative"], m["seed"], m["interrupted"]) == (3, 1, 7, False)
    assert m["recording"]["notes"] == ["one scan was late"]
    assert m["config"]["map"]["cell"] == 0.07
    assert m["versions"]["numpy"] == np.__version__


def test_which_trajectory_was_kept_and_why() -> None:
    """Nothing was settled; then the scans speak for what was, by 5.2 sigmas; good odometry contradicts it at scan 7."""
    assert metrics(make_result())["kept"] is None
    kept = metrics(replace(make_result(), kept=Kept("settled", 0.013, 5.2, (7,))))["kept"]
    assert kept == {"trajectory": "settled", "gain": 0.013, "sigmas": 5.2, "doubted": [7]}


def test_speed() -> None:
    speed = metrics(replace(make_result(), finish_seconds=0.005))["speed"]
    assert speed["phases"]["predict"]["median_ms"] == pytest.approx(2.0)
    assert speed["phases"]["predict"]["p95_ms"] == pytest.approx(3.6)  # 0.8 of the way from 2 to 4 ms
    assert speed["phases"]["predict"]["total_s"] == pytest.approx(0.010)
    assert speed["finish_s"] == 0.005
    assert speed["total_s"] == pytest.approx(0.025)
    assert speed["scans_per_second"] == pytest.approx(200)
    assert speed["ms_per_scan"] == pytest.approx(5)
    assert speed["times_real_time"] == pytest.approx(320)


@pytest.mark.parametrize("scans", [0, 1, 3, 5])
def test_is_json_whatever_was_done(scans: int) -> None:
    m = json.loads(json.dumps(metrics(make_result(scans)), allow_nan=False))
    assert m["scans"] == scans
    assert m["interrupted"] == (scans < 5)
    assert m["frames"] is None
    if scans == 0:
        assert m["truth"] is None and m["relations"] is None and m["end_to_start_gap_m"]["estimate"] is None
    if scans == 3:
        assert m["relations"] is None  # no relation ends in what was done


def test_finite() -> None:
    value = {
        "a": np.float32(1.5),
        "b": [math.nan, np.inf, 2],
        "c": np.array([1.0, np.nan]),
        "d": np.int64(3),
        "e": True,
    }
    assert finite(value) == {"a": 1.5, "b": [None, None, 2], "c": [1.0, None], "d": 3, "e": True}
    assert type(finite(np.int64(3))) is int
