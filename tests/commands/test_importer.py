import io
import subprocess
import sys
from pathlib import Path

import pytest

from pfslam_viz.commands import importer
from pfslam_viz.commands.importer import NOT_OURS, main, may_be_ours

Started = list[tuple[object, ...]]
LOG = "FLASER 3 {a:.2f} 1.50 1.20 0 0 0 {x:.1f} 0 0 {t} host {t}\n"


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> Started:
    """The replays that would have been started."""
    calls: Started = []
    monkeypatch.setattr(importer, "_replay", lambda *arguments: calls.append(arguments))
    return calls


def carmen_log(folder: Path, name: str = "drive.clf") -> Path:
    path = folder / name
    path.write_text("# a log\n" + "".join(LOG.format(t=k, a=2 - 0.1 * k, x=0.1 * k) for k in range(5)))
    return path


def course_set(folder: Path) -> Path:
    folder.mkdir()
    for stem in ("Hokuyo", "Encoders", "Imu"):
        (folder / f"{stem}21.npz").write_bytes(b"")
    return folder


@pytest.mark.parametrize("name", ["picture.png", "notes.txt", "weights.npz", "Imu21.npz", "noextension", "x.tar.gz"])
def test_other_files_are_refused(tmp_path: Path, name: str, started: Started) -> None:
    path = tmp_path / name
    path.write_bytes(b"anything")
    assert main([str(path)]) == NOT_OURS
    assert started == []


def test_a_log_of_somebody_else_is_refused(tmp_path: Path, started: Started) -> None:
    path = tmp_path / "server.log"
    path.write_text("2024-01-01 INFO started\n" * 50)
    assert main([str(path)]) == NOT_OURS
    assert main([str(tmp_path)]) == NOT_OURS  # nor is its folder ours
    assert main([str(tmp_path / "absent.clf")]) == NOT_OURS
    assert started == []


def test_a_carmen_log_is_taken_with_the_viewers_ids(tmp_path: Path, started: Started) -> None:
    path = carmen_log(tmp_path)
    arguments = ["--application-id", "drive", "--recording-id", "r1", "--opened-recording-id", "r0", "--static", "x"]
    assert main([str(path), *arguments]) == 0
    assert started == [(path, "drive", "r1", None)]


def test_a_sets_lidar_file_and_its_folder_are_taken(tmp_path: Path, started: Started) -> None:
    folder = course_set(tmp_path / "set")
    assert main([str(folder / "Hokuyo21.npz"), "--application-id", "Hokuyo21"]) == 0
    assert main([str(folder), "--application-id", "set"]) == 0
    assert [call[0] for call in started] == [folder / "Hokuyo21.npz", folder]


def test_a_folder_opened_whole_is_not_opened_again_file_by_file(tmp_path: Path, started: Started) -> None:
    folder = course_set(tmp_path / "set")
    for name in ("Hokuyo21.npz", "Imu21.npz"):
        assert main([str(folder / name), "--application-id", "set"]) == 0  # ours, and nothing to add
    assert main([str(folder / "notes.txt"), "--application-id", "set"]) == NOT_OURS
    assert main([str(folder / "Imu21.npz"), "--application-id", "Imu21"]) == NOT_OURS
    assert started == []


def test_a_failure_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = carmen_log(tmp_path)
    monkeypatch.setattr("pfslam_viz.viewer.sinks.open_sinks", None)  # never reached
    path.write_text("FLASER 3 1.0\n")
    assert main([str(path)]) in (2, NOT_OURS)
    assert capsys.readouterr().err.count("\n") <= 1


def test_the_command_refuses_quickly_without_importing_anything_heavy(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(b"\x89PNG")
    code = (
        "import sys; from pfslam_viz.commands.importer import main; status = main(sys.argv[1:]);"
        "print(status, [m for m in ('numpy', 'rerun', 'cv2', 'numba', 'scipy', 'pydantic') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "66 []"


@pytest.mark.slow
def test_it_writes_a_recording_to_standard_output(tmp_path: Path) -> None:
    path = tmp_path / "drive.clf"
    line = "FLASER 181 {ranges} {x} 0 0 {x} 0 0 {t} host {t}\n"
    ranges = " ".join(["2.5"] * 181)
    path.write_text("".join(line.format(ranges=ranges, x=0.05 * k, t=0.2 * k) for k in range(8)))
    arguments = [str(path), "--application-id", "drive", "--recording-id", "r1"]
    done = subprocess.run(
        [sys.executable, "-m", "pfslam_viz.commands.importer", *arguments], capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout[:4] == b"RRF2"
    out = tmp_path / "out.rrd"
    out.write_bytes(done.stdout)
    from rerun.chunk import RrdReader

    assert "/world/filter/map" in RrdReader(str(out)).store().schema().entity_paths()
    assert io.BytesIO(done.stdout).getbuffer().nbytes > 10_000


def test_names(tmp_path: Path) -> None:
    assert may_be_ours(tmp_path / "intel.clf.bz2")
    assert may_be_ours(tmp_path / "Hokuyo20.npz")
    assert not may_be_ours(tmp_path / "x.bz2")
