"""Runs whose memory, files or clock are not what they are used to."""

import itertools
import random
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pfslam_viz import cli

Run = Callable[..., tuple[int, str, str]]
PAPER = ["--config", "paper", "--particles", "10", "--stop", "60", "--quiet"]
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="limits of a process are Linux's")


def limited(limit: str, arguments: list[object]) -> tuple[int, str]:
    """Exit status and stderr of the command line under a limit of the shell's."""
    script = f'ulimit {limit}; exec "$0" -m pfslam_viz "$@"'
    done = subprocess.run(
        ["bash", "-c", script, sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stderr


@LINUX
@pytest.mark.parametrize("kilobytes", [300_000, 500_000])
def test_too_little_memory_never_leaves_a_file_that_is_not_whole(
    run: Run, drive: Path, tmp_path: Path, kilobytes: int
) -> None:
    """Python's own lack of it is told in one line; Rerun's core aborts the process, as Rust does."""
    out = tmp_path / "out.rrd"
    status, err = limited(f"-v {kilobytes}", ["replay", drive, "--save", out, *PAPER])
    if status == 0:  # where less is needed than on the machine this was written on
        assert out.read_bytes().startswith(b"RRF2")
        return
    assert not out.exists()
    assert "Traceback" not in err
    if status == 1:
        assert err.startswith("pfslam-viz: ") and err.count("\n") == 1
    assert run("replay", drive, "--save", out, *PAPER)[0] == 0
    assert list(tmp_path.iterdir()) == [out]  # what was left of the first run is gone


@LINUX
def test_few_open_files_are_enough(drive: Path, tmp_path: Path) -> None:
    assert limited("-n 40", ["replay", drive, "--save", tmp_path / "out.rrd", *PAPER]) == (0, "")


@pytest.mark.parametrize("jump", ["back an hour", "to and fro"])
def test_a_clock_that_is_set_during_the_run_changes_nothing(
    run: Run, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jump: str
) -> None:
    """Neither what comes out nor how long is waited for depends on the wall's clock."""
    assert run("replay", drive, "--export", tmp_path / "a", "--save", tmp_path / "a.rrd", *PAPER) == (0, "", "")
    plain, calls, rng = time.time, itertools.count(), random.Random(0)

    def jumping() -> float:
        k = next(calls)
        return plain() + (-3600.0 * (k > 2) if jump == "back an hour" else rng.uniform(-1e6, 1e6))

    monkeypatch.setattr(time, "time", jumping)
    assert run("replay", drive, "--export", tmp_path / "b", "--save", tmp_path / "b.rrd", *PAPER) == (0, "", "")
    for name in ("estimate.tum", "online.tum", "map.pgm", "map.yaml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_nothing_in_the_package_asks_for_the_time_of_day() -> None:
    package = Path(cli.__file__).parent
    asked = re.compile(r"\btime\.time(_ns)?\(|datetime\.now\(|from time import .*\btime\b")
    assert [path.name for path in package.rglob("*.py") if asked.search(path.read_text(encoding="utf-8"))] == []
