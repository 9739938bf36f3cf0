"""What may not be read, is not there any more, or was never named."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.recordings import catalog
from pfslam_viz.recordings.catalog import find, load_recording
from pfslam_viz.simulation.recording import simulate

Run = Callable[..., tuple[int, str, str]]
NOBODY = 65534
LINE = "FLASER 181 " + "2.50 " * 181 + "0 0 0 0 0 0 {t} host {t}\n"


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that every user of the machine may enter, as pytest's own is not."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    for path in folder.rglob("*"):
        path.chmod(0o755)
    shutil.rmtree(folder)


@contextmanager
def as_nobody() -> Iterator[None]:
    """As a user who is not root: root may read everything. What is imported must be so before."""
    if os.name != "posix":
        pytest.skip("permissions are those of POSIX")
    if os.geteuid() != 0:
        yield
        return
    os.setegid(NOBODY)
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(0)


def test_folders_and_files_that_may_not_be_read_are_called_so(run: Run, open_folder: Path) -> None:
    drive = simulate(open_folder / "drive", duration=5, frames=False)
    for folder in (drive, *drive.rglob("*")):
        folder.chmod(0o755)
    shutil.copytree(drive, open_folder / "file")
    (open_folder / "file" / "Hokuyo1.npz").chmod(0)
    (open_folder / "log.clf").write_text(LINE.format(t=1))
    (open_folder / "log.clf").chmod(0)
    for call in (("info", drive), ("recordings", "--data", open_folder)):
        assert run(*call)[0] == 0  # imports what it needs
    shutil.copytree(drive, open_folder / "folder")
    (open_folder / "folder").chmod(0)
    with as_nobody():
        for path in ("folder", "folder/Hokuyo1.npz", "file/Hokuyo1.npz", "log.clf"):
            status, out, err = run("info", open_folder / path)
            assert (status, out) == (2, "")
            assert err == f"pfslam-viz: {open_folder / path}: cannot be read: Permission denied\n"
        assert "cannot be read: Permission denied" in run("info", open_folder / "file")[2]
        assert run("recordings", "--data", open_folder / "folder")[0] == 2
        listed = run("recordings", "--data", open_folder)[1]
    assert "Hokuyo1.npz cannot be read" in listed
    assert "log.clf cannot be read" in listed
    assert "damaged" not in listed


@pytest.mark.parametrize("name", ["", " "])
def test_an_empty_name_is_not_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    simulate(tmp_path / "drive", duration=5, frames=False)
    monkeypatch.chdir(tmp_path / "drive")
    with pytest.raises(InputError, match="empty"):
        find(name)
    assert find(".").number == "1"


@pytest.mark.parametrize(
    "line",
    ["replay|", "replay|x|--save|", "replay|x|--save=", "replay|x|--export| ", "figures|x|", "simulate|", "info|",
     "evaluate|", "replay|x|--robot|", "replay|x|--data|", "config|", "fetch|", "video||out.png", "sweep||--out|y"],
)  # fmt: skip
def test_empty_arguments_are_wrong_use(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*line.split("|"))
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert " is empty: is a variable of the shell not set?" in err
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_vanishes_between_being_found_and_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "drive.clf"
    path.write_text(LINE.format(t=1))
    plain = catalog.load_place

    def load_place(*arguments: object) -> object:
        path.unlink()
        return plain(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(catalog, "load_place", load_place)
    with pytest.raises(InputError, match=r"drive\.clf: no such file"):
        load_recording(path)


def test_frames_that_vanish_during_the_run_cost_themselves_alone(run: Run, tmp_path: Path) -> None:
    out = simulate(tmp_path / "drive", duration=5)
    shutil.rmtree(out / "dataRGBD" / "Disparity1")
    status, _, err = run(
        "replay", out, "--export", tmp_path / "out", "--config", "paper", "--particles", 5, "--stop", 40
    )
    assert status == 0, err
    assert "0 of" in err and "disparity frames are here" in err


def damage_truth(folder: Path) -> None:
    (folder / "ground_truth.npz").write_bytes(b"PK\x03\x04 half")


def late_truth(folder: Path) -> None:
    np.savez(folder / "ground_truth.npz", time_stamps=np.arange(10.0), pose=np.zeros((10, 3)))


def damage_camera(folder: Path) -> None:
    (folder / "Kinect1.npz").write_bytes(b"no archive")


@pytest.mark.parametrize(
    ("damage", "word"), [(damage_truth, "truth"), (late_truth, "truth"), (damage_camera, "camera")]
)
def test_quiet_does_not_hide_that_a_part_was_left_out(
    run: Run, tmp_path: Path, damage: Callable[[Path], None], word: str
) -> None:
    out = simulate(tmp_path / "drive", duration=5, frames=False)
    damage(out)
    options = ["--config", "paper", "--particles", 5, "--stop", 10, "--quiet"]
    status, shown, err = run("replay", out, "--save", tmp_path / "out.rrd", *options)
    assert (status, shown) == (0, "")
    assert err.startswith(f"warning: {word}: ") and "left out" in err and err.count("\n") == 1
