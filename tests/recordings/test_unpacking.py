"""Files that hold far more than they weigh, or lines that never end, are refused before they fill the memory.

What is refused is refused within a process whose memory is bounded, so that a test fails where it is not.
"""

import bz2
import gzip
import importlib
import io
import pickle
import resource
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfslam_viz.config import load_config
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import carmen, images, npz, unpacking
from pfslam_viz.recordings.unpacking import TooLarge, read_file
from pfslam_viz.simulation.manifest import manifest_of

LINE = b"FLASER 181 " + b" ".join([b"2.50"] * 181) + b" 0 0 0 0 0 0 0.1 host 0.1\n"
NOTHING = b"# nothing\n" * 10_000  # 0.1 MB


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits of a megabyte instead of many."""
    monkeypatch.setattr(unpacking, "SURE", 1 << 20)
    monkeypatch.setattr(unpacking.allowance, "__defaults__", (1 << 20,))
    monkeypatch.setattr(npz, "SURE", 1 << 20)


def pack(kind: str, times: int) -> bytes:
    """A log of so many times 0.1 MB that weighs next to nothing."""
    text = LINE + NOTHING * times
    return bz2.compress(text) if kind == "bz2" else gzip.compress(text)


@pytest.mark.usefixtures("little")
@pytest.mark.parametrize("kind", ["bz2", "gz"])
@pytest.mark.parametrize("ending", [".clf", ".rawlog"])
def test_a_log_that_unpacks_to_too_much_is_refused(tmp_path: Path, kind: str, ending: str) -> None:
    path = tmp_path / f"bomb{ending}.{kind}"
    path.write_bytes(pack(kind, 12))
    with pytest.raises(InputError, match=rf"{path.name}: unpacks to more than 1 MB"):
        read_file(path, lines=ending == ".clf")


@pytest.mark.usefixtures("little")
@pytest.mark.parametrize("kind", ["bz2", "gz"])
def test_a_log_within_the_limits_is_read_whole(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"good.clf.{kind}"
    path.write_bytes(pack(kind, 3) + pack(kind, 0))  # two streams one after the other, as both programs allow
    assert read_file(path) == LINE + NOTHING * 3 + LINE
    assert len(carmen.load(path)) == 1


def test_what_packs_well_because_it_is_large_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    assert unpacking.allowance(6_000) == 64 << 20
    assert unpacking.allowance(10 << 20) == 1000 << 20
    assert unpacking.allowance(1 << 30) == 2 << 30


@pytest.mark.parametrize("name", ["long.clf", "long.clf.gz", "long.clf.bz2"])
def test_a_line_without_an_end_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    content = LINE + b"x" * (unpacking.LONGEST_LINE + 1) + b"\n" + LINE
    packers: dict[str, Callable[[bytes], bytes]] = {".clf": bytes, ".gz": gzip.compress, ".bz2": bz2.compress}
    path.write_bytes(packers[path.suffix](content))
    with pytest.raises(InputError, match=r"has a line of more than 4 MB"):
        carmen.load(path)


def test_lines_may_be_long_and_may_end_as_on_any_system(tmp_path: Path) -> None:
    for end in (b"\n", b"\r\n", b"\r"):
        path = tmp_path / "log.clf"
        second = LINE.replace(b"0.1", b"0.2")
        path.write_bytes((b"# " + b"x" * (3 << 20) + b"\n" + LINE + second).replace(b"\n", end))
        assert len(carmen.load(path)) == 2


@pytest.mark.parametrize("kind", ["bz2", "gz"])
def test_half_of_a_packed_log_is_damaged(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"half.clf.{kind}"
    path.write_bytes(pack(kind, 1)[:-20])
    with pytest.raises(InputError, match="damaged"):
        carmen.load(path)


def test_a_file_that_grows_is_read_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The writer appends faster than it is read: without a bound, this would not end."""
    path = tmp_path / "live.clf"
    path.write_bytes(LINE)
    plain = unpacking._read

    def read(file: io.BufferedReader, *arguments: object) -> bytes:
        with path.open("ab") as writer:
            writer.write(LINE * 3)
        return plain(file, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(unpacking, "_read", read)
    assert read_file(path) == LINE


def zip_of(path: Path, header: bytes, content: bytes, name: str = "ranges.npy") -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, header + content)


def npy_header(shape: str, descr: str = "'<f8'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


@pytest.mark.usefixtures("little")
def test_an_archive_that_unpacks_to_too_much_is_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "Hokuyo1.npz"
    np.savez_compressed(path, ranges=np.zeros((1081, 200)), time_stamps=np.arange(200.0))
    monkeypatch.setattr(np.lib.format, "read_array", lambda *_, **__: pytest.fail("was unpacked"))
    with pytest.raises(InputError, match=r"Hokuyo1\.npz: ranges would unpack to 2 MB out of a file of 0\.0 MB"):
        npz.read_arrays(path, ["ranges"])


@pytest.mark.parametrize(
    ("header", "content"),
    [
        (npy_header("(1081, 1000000000)"), b"\0" * 64),  # 8.6 TB by its header
        (npy_header("(8,)"), b"\0" * 640),
        (npy_header("(99999999999999999999,)"), b""),
        (npy_header("(8,)", "'|S1000000000'"), b"\0" * 64),
        (npy_header("(-8,)"), b"\0" * 64),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff", b"{" * 4096),
    ],
    ids=["terabytes", "too little", "beyond int64", "text", "negative", "endless header"],
)
def test_headers_that_do_not_fit_what_is_there(tmp_path: Path, header: bytes, content: bytes) -> None:
    path = tmp_path / "Hokuyo1.npz"
    zip_of(path, header, content)
    with pytest.raises(InputError, match=r"Hokuyo1\.npz: .*(damaged|not numbers)"):
        npz.read_arrays(path, ["ranges"])


def test_every_kind_of_array_is_read_as_it_was_saved(tmp_path: Path) -> None:
    path = tmp_path / "all.npz"
    arrays: dict[str, Any] = {
        "a": np.arange(6, dtype=">i2").reshape(2, 3), "b": np.asfortranarray(np.ones((3, 4), np.float32)),
        "c": np.float64(3.0), "d": np.zeros((0, 5)), "e": np.array([True, False]),
    }  # fmt: skip
    np.savez(path, **arrays)
    read = npz.read_arrays(path, arrays)
    assert all(np.array_equal(read[key], value) and read[key].dtype == value.dtype for key, value in arrays.items())


@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_a_pickle_is_called_one_and_not_run(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "Hokuyo1.npz"
    path.write_bytes(pickle.dumps({"ranges": [1.0]}, protocol))
    with pytest.raises(InputError, match=r"Hokuyo1\.npz: is a Python pickle, which could run code and is not read"):
        npz.read_arrays(path, ["ranges"])


def test_an_image_of_billions_of_pixels_is_not_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cv2 = pytest.importorskip("cv2")

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 30_000, 30_000, 8, 2, 0, 0, 0)
    path = tmp_path / "rgb1_1.png"
    path.write_bytes(images.PNG_START + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b""))
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("was decoded"))
    with pytest.raises(images.UnusableImage, match="unreadable"):
        images.read_image(path)


def test_settings_and_relations_are_no_large_files(tmp_path: Path) -> None:
    """Sparse files: they take no room on the disk, and would all in memory."""
    (tmp_path / "log.clf").write_bytes(LINE)
    for name in ("log.relations", "huge.toml", "simulation.json"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(100 << 20)
    (note,) = carmen.load(tmp_path / "log.clf").notes
    assert "log.relations is damaged" in note
    with pytest.raises(InputError, match=r"huge\.toml: cannot be read: File too large"):
        load_config(tmp_path / "huge.toml")
    assert manifest_of(tmp_path) is None


@pytest.mark.usefixtures("little")
@pytest.mark.parametrize("kind", ["bz2", "lz4", "zstd"])
def test_chunks_of_bags_are_bounded(kind: str) -> None:
    pytest.importorskip("rosbags.rosbag1")
    pack_one: Callable[[bytes], bytes] = bz2.compress
    if kind == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        pack_one = lz4.frame.compress
    elif kind == "zstd":
        pack_one = unpacking._zstd().compress
    unpack = getattr(unpacking, f"unpack_{kind}")
    small, large = b"a scan " * 1000, bytes(2 << 20)
    assert unpack(pack_one(small)) == small
    with pytest.raises(TooLarge, match="unpack to more than 1 MB"):
        unpack(pack_one(large))
    with pytest.raises((ValueError, RuntimeError, EOFError)):
        unpack(pack_one(small)[:-8])


def test_rosbags_unpacks_by_these_limits() -> None:
    ros1 = pytest.importorskip("rosbags.rosbag1.reader")
    from rosbags.rosbag2 import storage_mcap

    unpacking.bound_rosbags()
    assert ros1.decompressors["bz2"] is unpacking.unpack_bz2
    data = unpacking._zstd().compress(b"abc" * 100)
    assert storage_mcap.DECOMPRESSORS["zstd"](data, 300) == b"abc" * 100
    reader: Any = importlib.import_module("rosbags.rosbag2.reader")
    assert reader.zstd.decompress(data) == b"abc" * 100
    with reader.zstd.open(io.BytesIO(data), "rb") as file:
        assert file.read() == b"abc" * 100 and file.read() == b""


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
def test_a_bomb_is_refused_in_little_memory(tmp_path: Path) -> None:
    """A megabyte that holds 400 MB, with 200 MB of address space beyond what the imports take."""
    path = tmp_path / "bomb.clf.gz"
    path.write_bytes(gzip.compress(NOTHING * 1_500, 1)[: 640 << 10])
    script = f"""
import resource
from pathlib import Path
from typing import Any
from pfslam_viz.recordings import carmen
from pfslam_viz.config import load_config
from pfslam_viz.errors import InputError
size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + 200_000_000
resource.setrlimit(resource.RLIMIT_AS, (size, size))
try:
    carmen.load(Path({str(path)!r}))
except InputError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "bomb.clf.gz: unpacks to more than 64 MB" in done.stdout


def test_the_limits_of_this_process_are_as_they_were() -> None:
    assert resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY
