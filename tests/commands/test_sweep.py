"""The command, on real clusters: run, killed, interrupted, resumed."""

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from pfslam_viz import cli
from pfslam_viz.commands.sweep import _kept
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.sweep import engine
from pfslam_viz.sweep.plan import Block, make_plan
from pfslam_viz.sweep.results import Results
from pfslam_viz.sweep.row import TIMES

Run = Callable[..., tuple[int, str, str]]

CELLS = 12
SETTINGS = ("--config", "paper", "--set", "particles=50,300", "--set", "resampling.policy=always,n_eff", "--seeds", 3)


def arguments(drive: Path, out: Path, *more: object) -> list[str]:
    return [str(part) for part in ("sweep", drive, *SETTINGS, "--out", out, "--no-rrd", *more)]


def rows(out: Path, settled: bool = True) -> list[dict[str, str]]:
    """The rows of results.csv without what depends on the clock."""
    path = out / "results.csv"
    if not path.exists():
        return []
    with path.open(newline="") as file:
        found = list(csv.DictReader(file))
    return [{name: value for name, value in row.items() if name not in TIMES} for row in found] if settled else found


@pytest.fixture(scope="module")
def whole(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a sweep that ran through on two workers."""
    out = tmp_path_factory.mktemp("whole")
    assert cli.call(arguments(drive, out, "--workers", 2)) == 0
    return out


@pytest.fixture
def started(drive: Path, tmp_path: Path) -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Starts the command as a process of its own, which is ended with the test."""
    processes: list[subprocess.Popen[str]] = []

    def start(*more: object) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", "pfslam_viz", *arguments(drive, tmp_path, *more)]
        processes.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
        return processes[-1]

    yield start
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_for_rows(process: "subprocess.Popen[str]", out: Path, count: int) -> None:
    while len(rows(out)) < count:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def workers_of(process: "subprocess.Popen[str]") -> list[psutil.Process]:
    found = psutil.Process(process.pid).children(recursive=True)
    return [child for child in found if any("spawn_main" in part for part in child.cmdline())]


@pytest.mark.slow
def test_a_sweep_that_ran_through(whole: Path, drive: Path, run: Run) -> None:
    found = rows(whole)
    assert len(found) == CELLS and not any(row["error"] for row in found)
    keys = [(row["particles"], row["resampling.policy"], row["seed"]) for row in found]
    assert keys == [(n, p, s) for n in ("50", "300") for p in ("always", "n_eff") for s in "012"]
    assert len({row["position_rmse_m"] for row in found}) == CELLS
    files = {path.name for path in whole.iterdir()}
    assert files >= {"results.csv", "results.parquet", "table.md", "index.html", "curves-0.png", "maps-0.png", "cells"}
    before = (whole / "results.csv").read_text()
    status, printed, said = run(*arguments(drive, whole))
    assert status == 0 and "all of them are done" in said
    assert "best first by position_rmse_m" in printed
    assert (whole / "results.csv").read_text() == before


@pytest.mark.slow
def test_one_worker_gives_the_same_numbers(whole: Path, drive: Path, tmp_path: Path, run: Run) -> None:
    status, _, said = run(*arguments(drive, tmp_path, "--workers", 1))
    assert status == 0
    assert f"{CELLS} runs: 1 recording x 4 configurations x 3 seeds; about" in said and "on 1 worker" in said
    assert rows(tmp_path) == rows(whole)


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_only_time(
    whole: Path, tmp_path: Path, started: Callable[..., "subprocess.Popen[str]"]
) -> None:
    process = started("--workers", 2)
    wait_for_rows(process, tmp_path, 1)
    workers = workers_of(process)
    assert len(workers) == 2
    workers[0].kill()
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert rows(tmp_path) == rows(whole)


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done_and_the_same_command_goes_on(
    whole: Path, tmp_path: Path, started: Callable[..., "subprocess.Popen[str]"]
) -> None:
    process = started("--workers", 2)
    wait_for_rows(process, tmp_path, 2)
    children = psutil.Process(process.pid).children(recursive=True)
    for pid in (process.pid, *(child.pid for child in workers_of(process))):  # as a terminal does
        os.kill(pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    done = rows(tmp_path)
    assert 2 <= len(done) < CELLS
    last = said.splitlines()[-1]
    assert last.startswith("pfslam-viz: interrupted; ") and f"holds {len(done)} of {CELLS} runs" in last
    assert "Traceback" not in said
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive
    process = started("--workers", 2)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0
    assert f"{len(done)} are done, {CELLS - len(done)} are missing" in said
    assert rows(tmp_path) == rows(whole)
    assert {row["cell"] for row in done} < {row["cell"] for row in rows(whole)}


def test_what_is_kept_is_counted_among_the_runs_of_this_sweep(tmp_path: Path) -> None:
    """Rows of other runs in the folder do not count, nor does what failed."""
    plan = make_plan([("a", RecordingChoice("/a"))], [Block(("paper",), (("particles", ("1", "2")),))], range(5))
    kept = _kept(plan, missing=7, new=2, results=Results(tmp_path, plan.keys))
    assert kept.startswith(f"{tmp_path / 'results.csv'} holds 5 of 10 runs")


@pytest.mark.slow
def test_other_code_is_noticed(whole: Path, drive: Path, tmp_path: Path, run: Run) -> None:
    text = (whole / "results.csv").read_text()
    code = rows(whole)[0]["code"]
    (tmp_path / "results.csv").write_text(text.replace(code, "0.0.9+00000000"))
    status, _, said = run(*arguments(drive, tmp_path))
    assert status == 2
    assert "has runs of other code (12 of 0.0.9+00000000" in said and "--redo-old" in said
    status, _, said = run(*arguments(drive, tmp_path, "--keep-old"))
    assert status == 0 and "all of them are done" in said
    assert {row["code"] for row in rows(tmp_path)} == {"0.0.9+00000000"}


def test_a_scheduler_that_is_not_there(drive: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "CONNECT_SECONDS", 0.3)
    status, printed, said = run(*arguments(drive, tmp_path, "--scheduler", "tcp://127.0.0.1:1"))
    assert (status, printed) == (2, "")
    assert said.splitlines()[-1].startswith("pfslam-viz: --scheduler tcp://127.0.0.1:1: no Dask scheduler answers")
    assert "Traceback" not in said and not list(tmp_path.iterdir())


def test_a_note_says_which_of_several_recordings_it_is_about(
    drive: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "CONNECT_SECONDS", 0.3)
    other = shutil.copytree(drive, tmp_path / "other")
    nowhere = ("--scheduler", "tcp://127.0.0.1:1")
    _, _, alone = run(*arguments(drive, tmp_path, *nowhere))
    _, _, said = run(*arguments(drive, tmp_path, other, *nowhere))
    notes = [line for line in alone.splitlines() if line.startswith("note: ")]
    assert notes
    expected = [note.replace("note: ", f"note: {name}: ") for name in (drive, other) for note in notes]
    assert [line for line in said.splitlines() if line.startswith("note: ")] == expected


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--by", "speed"], "--by speed: no such column"),
        (["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"], "--workers is for a cluster on this machine"),
        (["--set", "particles=3"], "particles is set twice"),
        (["--set", "map.cell=0"], "--set map.cell=0: 'map.cell' = 0"),
        (["--plan", "none.toml"], "none.toml: no such sweep file"),
    ],
)
def test_wrong_use(drive: Path, tmp_path: Path, run: Run, more: list[str], message: str) -> None:
    status, _, said = run(*arguments(drive, tmp_path, *more))
    assert status == 2 and message in said.splitlines()[-1]
    assert not list(tmp_path.iterdir())


def test_without_dask(drive: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "find_spec", lambda name: None)
    status, _, said = run(*arguments(drive, tmp_path))
    assert status == 2 and said.splitlines()[-1].endswith("which is missing: pip install 'pfslam-viz[sweep]'")


def test_without_matplotlib(whole: Path, drive: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    missing: Any = lambda name: None  # noqa: E731
    monkeypatch.setattr("pfslam_viz.sweep.page.find_spec", missing)
    status, printed, said = run(*arguments(drive, whole))
    assert status == 0 and "best first by" in printed
    assert "index.html needs matplotlib, which is missing: pip install 'pfslam-viz[figures]'" in said
