"""What a replay spends on what: parts within parts count once, other threads' work is its asker's, the parts add up."""

import json
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from pfslam_viz.simulation.recording import simulate

pytest.importorskip("benchmarks", reason="needs the checkout on the path: run python -m pytest in its folder")

from benchmarks import profile
from benchmarks.case import ROOT


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds of processor, and ten times as many of the clock, that pass when the test says so."""
    now = [0.0]
    monkeypatch.setattr(profile, "thread_time", lambda: now[0])
    monkeypatch.setattr(profile, "perf_counter", lambda: 10.0 * now[0])
    return now


def test_a_part_within_a_part_counts_once(clock: list[float]) -> None:
    meter = profile.Meter()

    def wait(seconds: float) -> None:
        clock[0] += seconds

    def inner() -> None:
        wait(4.0)
        meter.within("inner", lambda: wait(8.0))

    def outer() -> str:
        wait(1.0)
        meter.within("inner", inner)
        wait(2.0)
        return "done"

    wait(16.0)  # of no part
    assert meter.within("outer", outer) == "done"
    wait(32.0)

    def failing() -> None:
        wait(64.0)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        meter.within("outer", failing)
    assert meter.processor == {"outer": 67.0, "inner": 12.0} and meter.wall == {"outer": 670.0, "inner": 120.0}
    assert meter.current() is None


def test_another_thread_has_no_time_of_the_clock(clock: list[float]) -> None:
    meter = profile.Meter()

    def work() -> None:
        clock[0] += 3.0

    thread = threading.Thread(target=lambda: meter.within("part", work))
    thread.start()
    thread.join()
    assert meter.processor == {"part": 3.0} and meter.wall == {}


def test_the_rest_is_what_no_part_has() -> None:
    parts = profile.whole({"filter": [2.0, 1.5], "imports": [1.0, 1.0]}, processor=5.0, wall=4.0)
    assert parts == {"imports": (1.0, 1.0), "filter": (2.0, 1.5), profile.REST: (2.0, 1.5), "all of it": (5.0, 4.0)}
    assert next(iter(parts)) == "imports"
    assert "| filter | 3.00 | 1.50 |" in profile.table([{"filter": (k, 1.5)} for k in (1.0, 3.0, 9.0)])


@pytest.mark.parametrize("config", ["paper", "default"])
def test_every_part_of_a_replay_is_measured(tmp_path: Path, config: str) -> None:
    drive = simulate(tmp_path / "drive", seed=3, duration=10.0)
    out = tmp_path / "parts.json"
    words = ["replay", str(drive), "--config", config, "--quiet", "--save", str(tmp_path / "out.rrd")]
    subprocess.run([sys.executable, "-m", "benchmarks.profile", str(out), *words], cwd=ROOT, check=True)
    found = json.loads(out.read_text())
    assert set(found) == set(profile.PARTS)
    assert all(processor > 0.0 for processor, _ in found.values())
