"""What a worker does with an order, in this process."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz.config import load_config
from pfslam_viz.evaluation.cell import run_cell
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.sweep import worker
from pfslam_viz.sweep.plan import Cell, Plan
from pfslam_viz.sweep.row import TIMES, numbers
from pfslam_viz.sweep.trace import FREE, UNKNOWN, WALL, read_trace
from pfslam_viz.sweep.version import code_version
from pfslam_viz.sweep.worker import Order, fingerprint, kind, load_kernels, receive, run_order


@pytest.fixture(autouse=True)
def nothing_received(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "_RECORDINGS", {})


@pytest.fixture
def warmed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The particles of the configurations that kernels are loaded with."""
    found: list[int] = []
    monkeypatch.setattr(worker, "_LOADED", set())
    monkeypatch.setattr(worker, "warm_up", lambda recording, config: found.append(config.particles))
    return found


@pytest.fixture
def cell(twelve: Plan, sweep_recording: Recording) -> Cell:
    return twelve.cells({"drive": fingerprint(sweep_recording)})[4]


def order(cell: Cell, recording: Recording, path: Path | str) -> Order:
    config = cell.config.model_dump(mode="json")
    return Order(cell.id, fingerprint(recording), RecordingChoice(str(path)), config, code_version())


def test_a_cell_has_the_numbers_of_the_bare_run(
    cell: Cell, sweep_recording: Recording, sweep_drive: Path, tmp_path: Path
) -> None:
    answer = run_order(order(cell, sweep_recording, sweep_drive))
    assert (answer.error, answer.lacks) == (None, False)
    result, scores = run_cell(sweep_recording, cell.config)
    bare = numbers(scores)
    assert {n: v for n, v in answer.row.items() if n in bare and n not in TIMES} == {
        n: v for n, v in bare.items() if n not in TIMES
    }
    assert answer.row["code"] == code_version() and answer.row["position_rmse_m"] is not None
    (tmp_path / "t.npz").write_bytes(answer.trace)
    trace = read_trace(tmp_path / "t.npz")
    assert trace is not None and trace.truth is not None
    np.testing.assert_allclose(trace.estimate, result.estimate, atol=1e-5)
    walls = np.argwhere(trace.image == WALL)
    assert len(walls) == result.grid.occupied.sum()
    left, top = trace.corner
    row, column = walls[0]
    x, y = left + (column + 0.5) * trace.cell, top - (row + 0.5) * trace.cell
    assert result.grid.occupied[tuple(result.grid.cells([[x, y]])[0])] == 1  # it lies where it says
    assert set(np.unique(trace.image)) == {UNKNOWN, FREE, WALL}


def test_a_recording_that_is_not_there_or_another_one_is_asked_for(
    cell: Cell, sweep_recording: Recording, sweep_drive: Path, tmp_path: Path
) -> None:
    assert run_order(order(cell, sweep_recording, tmp_path / "none")).lacks
    other = replace(order(cell, sweep_recording, sweep_drive), fingerprint="of another content")
    assert run_order(other).lacks
    receive(fingerprint(sweep_recording), sweep_recording)
    assert not run_order(order(cell, sweep_recording, tmp_path / "none")).lacks


def test_what_goes_wrong_in_a_cell_is_its_error(cell: Cell, sweep_recording: Recording) -> None:
    blind = replace(sweep_recording, ranges=np.zeros_like(sweep_recording.ranges))
    receive(fingerprint(blind), blind)
    answer = run_order(order(cell, blind, "nowhere"))
    assert answer.error is not None and "no cell of the map is occupied" in answer.error
    assert "\n" not in answer.error and answer.row["code"] == code_version()


def test_kernels_are_loaded_once_for_configurations_that_differ_in_numbers_alone(
    warmed: list[int], sweep_recording: Recording
) -> None:
    own = [["particles=1"], ["particles=2", "motion.variance=[0.1, 0.1, 0.1]"], ["particles=3", "motion.model=scaled"]]
    configs = [load_config("paper", settings) for settings in own]
    load_kernels(sweep_recording, [config.model_dump(mode="json") for config in configs])
    load_kernels(sweep_recording, [configs[1].model_dump(mode="json")])
    assert warmed == [1, 3]
    assert kind(configs[0]) != kind(load_config("default", ["particles=1"]))


def test_another_version_runs_nothing(cell: Cell, sweep_recording: Recording, sweep_drive: Path) -> None:
    answer = run_order(replace(order(cell, sweep_recording, sweep_drive), code="0.0.9+00000000"))
    assert (answer.code, answer.row, answer.error) == (code_version(), {}, None)


def test_the_fingerprint_is_of_all_that_counts(sweep_recording: Recording) -> None:
    first = fingerprint(sweep_recording)
    assert fingerprint(replace(sweep_recording, name="other", notes=("x",))) == first
    for name in ("stamps", "ranges", "odometry"):
        changed = getattr(sweep_recording, name).copy()
        changed[-1] += 0.5
        assert fingerprint(replace(sweep_recording, **{name: changed})) != first, name
    assert fingerprint(replace(sweep_recording, truth=None)) != first
