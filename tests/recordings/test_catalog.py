import os
from collections.abc import Callable
from pathlib import Path

import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.recordings import catalog
from pfslam_viz.recordings.catalog import find, is_recording, list_recordings, load_recording, recordings_dir

WriteSet = Callable[..., Path]
LOG = "FLASER 5 1 2 3 4 5 0 0 0 0 0 0 1.0 host 0\n"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Tests run in an empty folder, without the user's environment."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    monkeypatch.delenv(catalog.ENVIRONMENT, raising=False)
    return work


def test_where_recordings_lie(elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert recordings_dir().name == "recordings"
    (elsewhere / "recordings").mkdir()
    assert recordings_dir().resolve() == elsewhere / "recordings"
    monkeypatch.setenv(catalog.ENVIRONMENT, str(tmp_path / "mine"))
    assert recordings_dir() == tmp_path / "mine"


@pytest.mark.parametrize("place", ["", "data", "7", "7/data"])
def test_a_set_by_number(write_set: WriteSet, tmp_path: Path, place: str) -> None:
    folder = write_set(tmp_path / "top" / place)
    recording = load_recording("7", tmp_path / "top")
    assert (recording.name, recording.path) == ("7", folder)


def test_the_more_complete_of_two_places(write_set: WriteSet, tmp_path: Path) -> None:
    write_set(tmp_path / "top", Hokuyo=None)
    write_set(tmp_path / "top" / "7")
    assert load_recording("7", tmp_path / "top").path == tmp_path / "top" / "7"


def test_a_folder_by_its_name(write_set: WriteSet, tmp_path: Path) -> None:
    write_set(tmp_path / "top" / "mine")
    assert load_recording("mine", tmp_path / "top").name == "mine"
    assert load_recording("mine", tmp_path / "top" / "mine").name == "mine"


@pytest.mark.parametrize("file", ["hall.clf", "hall.log.gz", "hall/hall.gfs", "hall/other.log"])
def test_a_log_by_name(tmp_path: Path, file: str) -> None:
    import gzip

    path = tmp_path / "top" / file
    path.parent.mkdir(parents=True)
    path.write_bytes(gzip.compress(LOG.encode()) if path.suffix == ".gz" else LOG.encode())
    recording = load_recording("hall", tmp_path / "top")
    assert (recording.name, recording.path) == ("hall", path)


def test_a_log_under_the_name_of_its_origin(tmp_path: Path) -> None:
    (tmp_path / "fr-clinic_robotlaser.clf").write_text(LOG)
    assert load_recording("fr-clinic", tmp_path).name == "fr-clinic"


def test_paths(write_set: WriteSet, tmp_path: Path, elsewhere: Path) -> None:
    folder = write_set(elsewhere / "sets" / "run")
    assert load_recording("sets/run").name == "run"
    assert load_recording(Path("sets/run/Imu7.npz")).name == "7"
    assert load_recording("run", elsewhere / "sets").path == folder
    assert load_recording("run/Hokuyo7.npz", elsewhere / "sets").path == folder
    os.chdir(elsewhere / "sets")
    assert load_recording("run").name == "run"
    log = tmp_path / "x.log"
    log.write_text(LOG)
    assert load_recording(log).name == "x"


def test_the_environment_names_the_folder(write_set: WriteSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_set(tmp_path / "mine")
    monkeypatch.setenv(catalog.ENVIRONMENT, str(tmp_path / "mine"))
    assert load_recording("7").path == tmp_path / "mine"


def test_demo_is_made_on_first_use(write_set: WriteSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pfslam_viz.simulation import demo

    made = []

    def ensure(folder: Path) -> Path:
        made.append(folder)
        return write_set(folder / "demo")

    monkeypatch.setattr(demo, "ensure_demo", ensure)
    assert load_recording("demo", tmp_path).name == "demo"
    assert made == [tmp_path]


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("21", ["no recording '21' in", "Encoders21.npz, Hokuyo21.npz, Imu21.npz", "pfslam-viz fetch 21", "12 MB"]),
        ("intel", ["intel.clf.bz2", "'pfslam-viz fetch intel --data", "2.5 MB"]),
        ("99", ["Encoders99.npz", "--data"]),
        ("nonsense", ["known names are demo, 20, 21, 23, intel"]),
        ("a/b", ["a/b: no such file or folder"]),
        ("x.npz", ["x.npz: no such file or folder"]),
    ],
)
def test_what_is_not_there(tmp_path: Path, name: str, parts: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        load_recording(name, tmp_path)
    assert "\n" not in str(caught.value)
    for part in parts:
        assert part in str(caught.value)


def test_a_set_without_its_lidar_file(write_set: WriteSet, tmp_path: Path) -> None:
    write_set(tmp_path, number=21, Hokuyo=None)
    with pytest.raises(InputError, match=rf"set 21 lacks Hokuyo21\.npz; 'pfslam-viz fetch 21 --data {tmp_path}'"):
        load_recording("21", tmp_path)


def test_no_such_data_folder(tmp_path: Path) -> None:
    for call in (lambda: load_recording("21", tmp_path / "x"), lambda: list_recordings(tmp_path / "x")):
        with pytest.raises(InputError, match="no such folder"):
            call()


def test_files_of_other_kinds(tmp_path: Path) -> None:
    (tmp_path / "x.txt").write_text("hello")
    with pytest.raises(InputError, match=r"neither a set's file .* nor a CARMEN log"):
        load_recording(tmp_path / "x.txt")
    for name in ("a.log", "b.log"):
        (tmp_path / name).write_text(LOG)
    with pytest.raises(InputError, match="holds 2 logs; choose one"):
        load_recording(tmp_path)


def test_is_recording(write_set: WriteSet, tmp_path: Path) -> None:
    folder = write_set(tmp_path / "a")
    (tmp_path / "system.log").write_text("[12:00] INFO hello\n")
    (tmp_path / "x.log").write_text(LOG)
    assert is_recording(folder) and is_recording(folder / "Hokuyo7.npz") and is_recording(tmp_path / "x.log")
    assert not is_recording(tmp_path / "system.log") and not is_recording(tmp_path)
    assert not is_recording(tmp_path / "y.npz")


def test_list(write_set: WriteSet, tmp_path: Path) -> None:
    top = tmp_path / "top"
    write_set(top / "mine")
    write_set(top / "21", number=21)
    write_set(top, number=20, Hokuyo=None)
    write_set(top / "two", number=7)
    write_set(top / "two", number=8)
    (top / "intel.clf").write_text(LOG)
    (top / "intel.relations").write_text("")
    entries = {entry.name: entry for entry in list_recordings(top)}
    assert entries["demo"].status == "made on first use"
    assert (entries["23"].status, entries["23"].size, entries["23"].path) == ("can be fetched", "12 MB", None)
    assert (entries["21"].status, entries["21"].length, entries["21"].path) == ("here", "1 s, 11 scans", top / "21")
    assert entries["20"].status == "incomplete: lacks Hokuyo20.npz"
    assert (entries["mine"].status, entries["mine"].sensors) == ("here", "lidar, encoders, IMU")
    assert entries["intel"].sensors == "lidar, odometry, relations"
    assert {"two/Hokuyo7.npz", "two/Hokuyo8.npz"} <= set(entries)
    for name in ("21", "mine", "two/Hokuyo8.npz", "intel"):
        assert find(name, top).path == entries[name].path
    assert len(entries) == len(list_recordings(top)) == 9 + 3


def test_list_with_a_damaged_file(write_set: WriteSet, tmp_path: Path) -> None:
    (write_set(tmp_path / "mine") / "Hokuyo7.npz").write_bytes(b"PK")
    assert list_recordings(tmp_path)[-1].status == "Hokuyo7.npz is damaged"


def test_list_of_a_folder_that_is_not_there_yet() -> None:
    assert all(entry.path is None for entry in list_recordings() if entry.status == "can be fetched")


def test_shared_data(shared_data: Path) -> None:
    assert len(load_recording("21", shared_data / "twin21")) == 4785
    assert load_recording(str(shared_data / "twin21")).name == "twin21"
    assert load_recording("fr079", shared_data / "carmen").relations is not None
    with pytest.raises(InputError, match=r"lacks Hokuyo23\.npz"):
        load_recording("23", shared_data / "ece276a")


def test_what_a_value_says_of_itself_is_said_with_the_file(tmp_path: Path) -> None:
    log = tmp_path / "near.clf"
    log.write_text("PARAM robot_front_laser_max 0.01\nFLASER 3 1 1 1 0 0 0 0 0 0 1.0 host 1.0\n")
    with pytest.raises(InputError, match=r"near\.clf: lidar\.range_min is 0\.05 m and lidar\.range_max 0\.01 m"):
        load_recording(log)
