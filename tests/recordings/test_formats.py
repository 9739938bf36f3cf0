"""The table of formats: every row works, and one row more is all that a new format needs."""

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from pfslam_viz.commands import importer
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import carmen, ece276a, formats
from pfslam_viz.recordings.catalog import find, is_recording, list_recordings, load_recording
from pfslam_viz.recordings.formats import Format, Glance, LoadOptions, Place, Reader, format_of
from pfslam_viz.recordings.info import describe_path
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.recordings.sources import SOURCES

WriteSet = Callable[..., Path]


class ToyReader(Reader):
    """A text file of ranges, one scan a line."""

    def load(self, place: Place, options: LoadOptions) -> Recording:
        ranges = np.loadtxt(place.path, ndmin=2)
        angles = np.linspace(-1, 1, ranges.shape[1])
        notes = [f"read with {options.scan_topic}"]
        return Recording.from_arrays(
            np.arange(len(ranges)), ranges, angles, name=place.name, format="toy", path=place.path, notes=notes
        )

    def looks_like(self, path: Path) -> bool:
        return path.read_text()[:1].isdigit()

    def glance(self, place: Place) -> Glance:
        return Glance("lidar", f"{len(place.path.read_text().splitlines())} scans")


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder with a recording of a format that is registered by one row."""
    module = ModuleType("toy_format")
    module.READER = ToyReader()  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "toy_format", module)
    row = Format(
        "toy", "a toy file (.toy)", "toy", re.compile(r"(?P<name>.+)\.toy"), "toy_format", options=("scan_topic",)
    )
    monkeypatch.setattr(formats, "FORMATS", (*formats.FORMATS, row))
    folder = tmp_path / "top"
    folder.mkdir()
    (folder / "drive.toy").write_text("1 2 3\n1 2 3\n")
    return folder


def test_a_row_is_found_and_loaded(toy: Path) -> None:
    for recording in (load_recording("drive", toy), load_recording(toy / "drive.toy"), load_recording(toy)):
        assert (recording.name, recording.format, recording.ranges.tolist()) == ("drive", "toy", [[1, 2, 3]] * 2)
    assert find("drive.toy", toy) == find("drive", toy)
    (toy / "other.toy").write_text("1\n")
    with pytest.raises(InputError, match=r"holds 2 toys; choose one, such as .*drive\.toy"):
        load_recording(toy)


def test_a_row_is_listed_and_described(toy: Path) -> None:
    sub = toy / "sub"
    sub.mkdir()
    for name in ("a.toy", "b.toy"):
        (sub / name).write_text("1\n")
    entries = {entry.name: entry for entry in list_recordings(toy)}
    assert (entries["drive"].format, entries["drive"].sensors, entries["drive"].length) == ("toy", "lidar", "2 scans")
    assert entries["sub/a.toy"].path == sub / "a.toy" == find("sub/a.toy", toy).path
    out = describe_path("drive", toy)
    assert (out["format"], out["lidar"]["scans"], out["lidar"]["beams"]) == ("toy", 2, 3)  # type: ignore[index]


def test_a_row_is_claimed_by_the_importer(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = []
    monkeypatch.setattr(importer, "_replay", lambda *arguments: started.append(arguments[0]))
    assert not is_recording(toy)  # one file in it does not make the folder ours
    (toy / "no.toy").write_text("hello")
    assert is_recording(toy / "drive.toy") and not is_recording(toy / "no.toy")
    assert importer.main([str(toy / "drive.toy")]) == 0
    assert importer.main([str(toy / "no.toy")]) == importer.NOT_OURS
    assert started == [toy / "drive.toy"]


def test_messages_name_a_row(toy: Path) -> None:
    (toy / "x.txt").write_text("")
    with pytest.raises(InputError, match=r"neither a set's file .* nor a CARMEN log .* nor a toy file \(\.toy\)$"):
        load_recording(toy / "x.txt")


def test_options_reach_the_format_that_reads_them_and_are_refused_by_others(toy: Path) -> None:
    assert load_recording("drive", toy, scan_topic="/front").notes[0] == "read with /front"
    assert describe_path("drive", toy, scan_topic="/front")["notes"][0] == "read with /front"  # type: ignore[index]
    with pytest.raises(InputError, match=r"drive\.toy: a toy file .* is read without base_frame; it is for a ROS"):
        load_recording("drive", toy, base_frame="base")
    (toy / "x.log").write_text("")
    with pytest.raises(InputError, match=r"read without scan_topic; it is for a ROS bag .* or a toy file \(\.toy\)$"):
        load_recording("x", toy, scan_topic="/front")
    with pytest.raises(TypeError, match="topics"):
        load_recording("drive", toy, topics="/front")


def test_a_folder_that_is_one_recording(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its files are the recording's, and a viewer that opens the folder is not given them again."""

    class FolderReader(ToyReader):
        def find(self, folder: Path, row: Format) -> list[Place]:
            return [Place(folder.name, folder, row.name)] if (folder / "toy.yaml").exists() else []

        def place(self, path: Path, row: Format) -> Place:
            return Place(path.parent.name, path.parent, row.name)

        def glance(self, place: Place) -> Glance:
            return Glance("lidar", "much")

    bag = toy / "bag"
    bag.mkdir()
    for name in ("toy.yaml", "bag_0.toy", "bag_1.toy"):
        (bag / name).write_text("")
    sys.modules["toy_format"].READER = FolderReader()  # type: ignore[attr-defined]
    *rows, row = formats.FORMATS
    monkeypatch.setattr(formats, "FORMATS", (*rows, replace(row, folder=("toy.yaml",))))
    assert find("bag", toy).path == find(bag / "bag_1.toy").path == find(str(bag)).path == bag
    assert [entry.path for entry in list_recordings(toy) if entry.name == "bag"] == [bag]
    assert is_recording(bag)
    started = []
    monkeypatch.setattr(importer, "_replay", lambda *arguments: started.append(arguments[0]))
    assert importer.main([str(bag), "--application-id", "bag"]) == 0
    assert importer.main([str(bag / "bag_0.toy"), "--application-id", "bag"]) == 0
    assert started == [bag]


def test_rows_say_what_the_loaders_say(tmp_path: Path) -> None:
    """The patterns, which import nothing, against the loaders' own ideas of their files' names."""
    names = [
        "intel.clf.bz2", "a.LOG", "a.b.gfs.GZ", "x.bz2", ".log", "a.clf.zip", "Hokuyo21.npz", "Kinect3.npz",
        "Imu7.npz.bak", "hokuyo21.npz", "Imu.npz", "RGB21.npz",
    ]  # fmt: skip
    for path in map(Path, names):
        row = format_of(path)
        assert (row is not None and row.name == "carmen") == carmen.is_log(path), path
        assert (row is not None and row.name == "ece276a") == (ece276a.set_number(path) is not None), path
        if row is not None:
            assert row.name_of(path) == (ece276a.set_number(path) or carmen.log_name(path))


def test_every_row_has_a_reader_and_every_source_a_row() -> None:
    assert all(isinstance(row.reader, Reader) for row in formats.FORMATS)
    assert {source.format for source in SOURCES.values()} <= {row.name for row in formats.FORMATS}


def test_importing_the_table_and_the_catalog_imports_nothing_heavy() -> None:
    code = (
        "import sys; import pfslam_viz.recordings.formats as f;"
        "light = [m for m in ('numpy', 'pydantic') if m in sys.modules];"
        "import pfslam_viz.recordings.catalog; [row.reader for row in f.FORMATS];"
        "print(light, [m for m in ('numba', 'scipy', 'rerun', 'cv2', 'rosbags') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[] []"


def test_a_set_in_data_below_the_folder(write_set: WriteSet, tmp_path: Path) -> None:
    folder = write_set(tmp_path / "top" / "data")
    assert find(str(tmp_path / "top")) == Place("top", folder, "ece276a", "7", folder / "Hokuyo7.npz")
    assert [entry.path for entry in list_recordings(tmp_path / "top") if entry.path] == [folder]
