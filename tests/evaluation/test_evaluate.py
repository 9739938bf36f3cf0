"""Running and scoring, end to end on a short simulated drive."""

import json
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.config import load_config
from pfslam_viz.evaluation.evaluate import evaluate
from pfslam_viz.evaluation.report import Report
from pfslam_viz.recordings.recording import Lidar, Recording, Relations, Trajectory
from pfslam_viz.slam.paper.settings import PaperConfig


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Straight through the middle of a 6 x 4 m room, 2 m in 40 scans, with wheels that are 10 % too long."""
    n, angles = 40, np.linspace(-np.pi, np.pi, 180, endpoint=False)
    truth = np.stack([np.linspace(0, 2, n), np.zeros(n), np.zeros(n)], axis=-1)
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        to_x = np.where(c > 0, (4 - truth[:, :1]) / c, (-2 - truth[:, :1]) / c)
        to_y = 2 / np.abs(s)
    steps = np.zeros_like(truth)
    steps[1:] = geometry.between(truth[:-1], truth[1:]) * [1.1, 1, 1]
    stamps = 100.0 + np.arange(float(n)) * 0.1
    return Recording(
        name="room",
        format="test",
        path=Path("room"),
        stamps=stamps,
        ranges=np.minimum(to_x, to_y).astype(np.float32),
        lidar=Lidar(angles, 0.1, 30.0, np.zeros(3)),
        odometry=steps,
        truth=Trajectory(stamps, geometry.compose([3.0, 1.0, 0.4], truth)),
        relations=Relations(stamps[[0, 10]], stamps[[39, 39]], geometry.between(truth[[0, 10]], truth[[39, 39]])),
    )


@pytest.fixture(scope="module")
def report(recording: Recording) -> Report:
    mine = PaperConfig(name="mine", particles=30)
    return evaluate(recording, [mine], [1, 2], None)


def test_runs_every_configuration_and_seed_and_the_paper_beside_it(report: Report) -> None:
    assert [method.name for method in report.methods] == ["dead reckoning", "mine", "paper"]
    assert [[run.seed for run in method.runs] for method in report.methods] == [[None], [1, 2], [1, 2]]
    assert report.methods[1].config is not None and report.methods[1].config.particles == 30
    first, second = report.methods[1].runs
    assert first.scores["truth"] != second.scores["truth"]  # the seed does reach the filter


def test_dead_reckoning_scores_what_its_wheels_do(report: Report) -> None:
    scores = report.methods[0].runs[0].scores
    assert scores["truth"]["position_final_m"] == pytest.approx(0.2, abs=1e-6)
    assert scores["truth"]["position_rmse_m"] == pytest.approx(np.sqrt(np.mean(np.linspace(0, 0.2, 40) ** 2)), abs=1e-6)
    assert scores["relations"]["translation_mean_m"] == pytest.approx((0.2 + 0.2 * 29 / 39) / 2, abs=1e-6)
    assert scores["map"]["path_ratio"] == pytest.approx(1.0)
    assert "speed" not in scores


def test_every_run_is_scored_in_full(report: Report) -> None:
    for method in report.methods[1:]:
        for run in method.runs:
            assert run.scores["truth"]["position_final_m"] < 0.2  # walls at both ends tell how far it went
            assert run.scores["relations"]["matched"] == 2
            assert 0 < run.scores["map"]["wall_thickness_m"] < 0.1
            assert run.scores["map"]["scan_to_map_score"] > 0.5
            assert run.scores["speed"]["times_real_time"] > 0
    json.dumps(report.as_dict(), allow_nan=False)


def test_progress_and_no_second_paper(recording: Recording) -> None:
    seen: list[tuple[str, int, int]] = []
    short = recording.select(0, 5)
    report = evaluate(short, [load_config("paper", ["particles=20"])], [3], lambda *a: seen.append(a))
    assert [method.name for method in report.methods] == ["dead reckoning", "paper"]
    assert seen == [("paper, seed 3", k, 5) for k in range(1, 6)]
