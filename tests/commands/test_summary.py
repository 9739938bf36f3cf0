"""The rows about a run at its end."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from pfslam_viz.commands.summary import summary
from pfslam_viz.config import load_config
from pfslam_viz.recordings.recording import Lidar, Recording
from pfslam_viz.replay import Replay, Result
from pfslam_viz.slam.protocol import Kept


@pytest.fixture(scope="module")
def result() -> Result:
    """Three scans of a wall 2 m ahead."""
    lidar = Lidar(np.linspace(-1.0, 1.0, 31), 0.1, 30.0, np.zeros(3))
    ranges = np.tile(2.0 / np.cos(lidar.angles), (3, 1)).astype(np.float32)
    recording = Recording(
        name="wall", format="test", path=Path("wall"), stamps=np.arange(3.0), ranges=ranges, lidar=lidar,
        odometry=np.zeros((3, 3)),
    )  # fmt: skip
    replay = Replay(recording, load_config("paper", ["particles=5"]), threads=1)
    list(replay)
    return replay.result()


@pytest.mark.parametrize(
    ("kept", "row"),
    [
        (Kept("settled", 0.02, 5.24), "kept settled: the scans speak for it by 5.2 sigmas"),
        (
            Kept("settled", -0.01, -1.24),
            "kept settled: odometry speaks for it, and the scans not clearly against it (-1.2 sigmas)",
        ),
        (Kept("online", -0.01, -3.0), "kept online: the scans do not speak for the settled trajectory"),
        (None, None),
    ],
)
def test_which_trajectory_was_kept_is_said(kept: Kept | None, row: str | None, result: Result) -> None:
    console = Console(file=io.StringIO(), width=120)
    console.print(summary(replace(result, kept=kept), 1.0))
    assert isinstance(console.file, io.StringIO)
    lines = [" ".join(line.split()) for line in console.file.getvalue().splitlines()]
    assert [line for line in lines if line.startswith(("kept", "doubtful"))] == ([] if row is None else [row])


@pytest.mark.parametrize(("doubted", "where"), [((1105,), "scan 1,105"), ((2, 40, 1105), "3 scans, first at 2")])
def test_where_good_odometry_says_otherwise_is_said(doubted: tuple[int, ...], where: str, result: Result) -> None:
    console = Console(file=io.StringIO(), width=120)
    console.print(summary(replace(result, kept=Kept("settled", 0.02, 5.2, doubted)), 1.0))
    assert isinstance(console.file, io.StringIO)
    text = " ".join(console.file.getvalue().split())
    assert f"doubtful at {where}: odometry that is right elsewhere says otherwise, one of the two is wrong" in text
