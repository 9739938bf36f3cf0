"""Every command that writes, on a disk that is full: one line with the file's name, exit status 1, no half file.

The disk is a file system in memory, which root alone can mount; elsewhere the tests skip.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pfslam_viz.errors import PfslamError
from pfslam_viz.recordings.download import Patience, Request, download

Run = Callable[..., tuple[int, str, str]]
PAPER = ["--config", "paper", "--particles", "10", "--quiet"]
FULL = "No space left on device"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Mounts a disk of a size such as ``200k``, and returns its folder."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = []

    def mount(size: str) -> Path:
        if sys.platform != "linux" or os.geteuid() != 0:
            pytest.skip("only root can mount a small disk")
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", disk], capture_output=True, check=False
        )
        if done.returncode:
            pytest.skip(f"no small disk can be mounted here: {done.stderr.decode().strip()}")
        mounted.append(disk)
        return disk

    yield mount
    for disk in mounted:
        subprocess.run(["umount", "--lazy", disk], check=True)


def pfslam(*arguments: object) -> tuple[int, str]:
    """The command line in a process of its own: exit status, and what is on stderr, Rerun's own words included."""
    done = subprocess.run(
        [sys.executable, "-m", "pfslam_viz", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stderr


def test_saving_ends_at_once_in_one_line(drive: Path, small_disk: Callable[[str], Path]) -> None:
    disk = small_disk("200k")
    (disk / "old.rrd").write_bytes(b"RRF2 pfslam-viz")
    for name in ("new.rrd", "old.rrd"):
        status, err = pfslam("replay", drive, "--save", disk / name, *PAPER)
        assert (status, err) == (1, f"pfslam-viz: {disk / name}: cannot be written: {FULL}\n")
    assert {p.name: p.read_bytes() for p in disk.iterdir()} == {"old.rrd": b"RRF2 pfslam-viz"}


def test_standard_output_is_not_cut_off_in_silence(drive: Path, small_disk: Callable[[str], Path]) -> None:
    """Also where it is the last bytes alone that find no room, after the last scan."""
    reason = f"pfslam-viz: standard output cannot be written: {FULL}; what is there is cut off\n"
    whole = drive.parent / "whole.rrd"
    command = [sys.executable, "-m", "pfslam_viz", "replay", str(drive), "--stdout", "--stop", "60", *PAPER]
    with whole.open("wb") as out:
        subprocess.run(command, stdout=out, check=True)
    pages = whole.stat().st_size // 4096
    disk = small_disk(f"{4 * (pages - 2)}k")
    with (disk / "out.rrd").open("wb") as out:
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (1, reason)


@pytest.mark.parametrize(
    ("size", "command", "named"),
    [
        ("28k", ["replay", "DRIVE", "--export", "OUT", *PAPER], "OUT/"),
        ("100k", ["figures", "DRIVE", "OUT", "--every", "50", *PAPER], "OUT/"),
        ("200k", ["simulate", "OUT", "--duration", "5", "--no-frames"], "OUT:"),
        ("700k", ["simulate", "OUT", "--duration", "5"], "OUT:"),
        ("200k", ["info", "demo", "--data", "DISK"], "DISK/demo:"),
        ("60k", ["sweep", "DRIVE", "--config", "paper,particles=10", "--quiet", "--out", "OUT"], "OUT/"),
    ],
    ids=["export", "figures", "simulate", "simulate frames", "demo", "sweep"],
)
def test_other_commands_name_what_they_could_not_write(
    run: Run, drive: Path, small_disk: Callable[[str], Path], size: str, command: list[str], named: str
) -> None:
    if command[0] == "figures":
        pytest.importorskip("matplotlib")
    if command[0] == "sweep":
        pytest.importorskip("distributed")
    disk = small_disk(size)
    out = disk / "out"
    places = {"DRIVE": drive, "OUT": out, "DISK": disk}
    status, _, err = run(*(places.get(part, part) for part in command))
    assert status == 1
    line = err.splitlines()[-1]
    assert line.startswith("pfslam-viz: ") and line.endswith(FULL)
    assert named.replace("OUT", str(out)).replace("DISK", str(disk)) in line
    assert not [path for path in disk.rglob("*") if ".part" in path.name]


def test_a_download_to_a_full_disk(small_disk: Callable[[str], Path], tmp_path: Path) -> None:
    import functools
    import http.server
    import threading

    (tmp_path / "log").write_bytes(bytes(1 << 20))
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=tmp_path)
    disk = small_disk("200k")
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        request = Request([f"http://127.0.0.1:{server.server_port}/log"], disk / "intel.clf", lambda _: None)
        with pytest.raises(PfslamError, match=rf"intel\.clf: cannot be written: {FULL}"):
            download(request, patience=Patience(timeout=5, tries=1))
        server.shutdown()
    assert list(disk.iterdir()) == []


def test_a_film_that_finds_no_room_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The viewer itself is left out."""
    import contextlib

    import numpy as np

    from pfslam_viz.viewer import film

    class Writer:
        def add(self, picture: object) -> None:
            pass

        def close(self) -> None:
            raise PfslamError("the film could not be written (is the disk full?)")

    class Viewer:
        def __getattr__(self, name: str) -> Callable[..., object]:
            return lambda *_: np.zeros((2, 2, 3), np.uint8)

    monkeypatch.setattr(film, "film_writer", lambda _: Writer())
    monkeypatch.setattr(film, "_stage", lambda *_: contextlib.nullcontext(Viewer()))
    with pytest.raises(PfslamError, match=r"out\.mp4: the film could not be written"):
        film.film(tmp_path / "in.rrd", tmp_path / "out.mp4", film.Scene(), np.array([1, 2]))
    assert list(tmp_path.iterdir()) == []
