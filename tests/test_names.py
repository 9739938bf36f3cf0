"""Names that are no text, and names that would act on a terminal."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.names import path_for_rerun, readable
from pfslam_viz.recordings.catalog import find, load_recording
from pfslam_viz.simulation.recording import simulate

Run = Callable[..., tuple[int, str, str]]
HEBREW = "מסדרון"


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("corridor 3", "corridor 3"),
        ("größe", "größe"),
        (HEBREW, HEBREW),
        ("gr\udcf6\udcdf", "gr??"),
        ("a\x1b[2Jb", "a?[2Jb"),
        ("a\nb\tc\x7f", "a?b?c?"),
        ("log\u202egpj.clf", "log?gpj.clf"),
        ("a\u2066b\u2069c", "a?b?c"),
    ],
)
def test_what_is_shown_of_a_name(name: str, shown: str) -> None:
    assert readable(name) == shown
    readable(name).encode()


def test_a_path_for_rerun_is_the_same_file(tmp_path: Path) -> None:
    for name in ("out.rrd", "größe.rrd", f"{HEBREW}.rrd"):
        assert path_for_rerun(tmp_path / name).encode() == os.fsencode(tmp_path / name)
    with pytest.raises(InputError, match="not UTF-8"):
        path_for_rerun(tmp_path / "\udcf6.rrd")


@pytest.mark.skipif(os.name != "posix" or os.uname().sysname == "Darwin", reason="needs names of any bytes")
def test_a_recording_and_a_file_whose_names_are_no_utf_8(run: Run, tmp_path: Path) -> None:
    out = simulate(tmp_path / "drive", duration=5, frames=False)
    odd = tmp_path / "gr\udcf6\udcdfe"
    shutil.move(out, odd)
    recording = load_recording(odd)
    assert recording.name == "gr??e"
    options = ["--config", "paper", "--particles", 10, "--stop", 10, "--quiet"]
    before = sorted(tmp_path.iterdir())
    status, _, err = run("replay", odd, "--save", tmp_path / "o\udcf6.rrd", *options)
    assert (status, err.count("\n")) == (2, 1)
    assert "o?.rrd: the name is not UTF-8" in err
    assert sorted(tmp_path.iterdir()) == before
    assert run("replay", odd, "--save", tmp_path / "good.rrd", *options) == (0, "", "")


def test_names_written_from_right_to_left(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / HEBREW
    simulate(folder, duration=5, frames=False)
    assert find(HEBREW, tmp_path).name == HEBREW
    path, export = tmp_path / f"{HEBREW}.rrd", tmp_path / f"{HEBREW} יצוא"
    options = ["--data", tmp_path, "--config", "paper", "--particles", 10, "--stop", 10]
    status, out, err = run("replay", HEBREW, "--save", path, "--export", export, *options)
    assert status == 0, err
    assert out.startswith(f"{HEBREW}, paper: 10 scans")
    assert HEBREW.encode() in path.read_bytes()  # as the recording's name
    assert (export / "metrics.json").is_file()
    assert HEBREW in run("recordings", "--data", tmp_path)[1]
