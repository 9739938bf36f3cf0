"""What is told while kernels are compiled."""

from pathlib import Path

import numpy as np
import pytest
from numba import njit

from pfslam_viz.commands import progress
from pfslam_viz.recordings.recording import Lidar, Recording


def empty_recording() -> Recording:
    lidar = Lidar(np.zeros(1), 0.1, 30.0, np.zeros(3))
    return Recording("x", "test", Path("x"), np.arange(2.0), np.ones((2, 1), np.float32), lidar, np.zeros((2, 3)))


@pytest.mark.parametrize("quiet", [False, True])
def test_compiling_is_told_once_a_run_and_never_when_quiet(monkeypatch: pytest.MonkeyPatch, quiet: bool) -> None:
    told: list[str] = []
    monkeypatch.setattr("pfslam_viz.console.tell", told.append)
    progress._say_compiling.cache_clear()
    for _ in range(2):
        with progress.replay_progress(empty_recording(), quiet) as bar:
            assert njit()(lambda x: x + 1)(1) == 2
            bar.advance()
    progress._say_compiling.cache_clear()
    assert told == ([] if quiet else [progress.COMPILING])


def test_several_runs_share_one_bar() -> None:
    with progress.replay_progress(empty_recording(), True, "compare", runs=3) as bar:
        assert [task.total for task in bar._progress.tasks] == [6]
