"""What is not the viewer that it should be: another program at the port, or a recording of another version."""

import socket
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.viewer import sinks
from pfslam_viz.viewer.film import Clock
from pfslam_viz.viewer.sinks import open_sinks
from tests.viewer.test_sinks import send

if TYPE_CHECKING:
    from tests.viewer.conftest import Readable

ANSWERS = {
    "silent": b"",
    "a web server": b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n",
    "a viewer that refuses": b"\x00\x00\x00\x04\x00\x00\x00\x00\x00",  # HTTP/2's settings, and no more
}


@pytest.fixture(params=ANSWERS)
def stranger(request: pytest.FixtureRequest) -> Iterator[str]:
    """The URL of a program that takes connections and is no viewer of ours."""
    answer = ANSWERS[request.param]
    kept: list[socket.socket] = []

    def serve() -> None:
        while True:
            try:
                connection, _ = listening.accept()
            except OSError:
                return
            kept.append(connection)
            if answer:
                with suppress(OSError):
                    connection.sendall(answer)
                    connection.shutdown(socket.SHUT_WR)

    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen(8)
        threading.Thread(target=serve, daemon=True).start()
        yield f"rerun+http://127.0.0.1:{listening.getsockname()[1]}/proxy"
    for connection in kept:
        connection.close()


def test_a_program_that_is_no_viewer_costs_the_picture_and_not_the_file(
    stranger: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read_back: "type[Readable]"
) -> None:
    for name in ("FLUSH_SECONDS", "CLOSE_SECONDS"):
        monkeypatch.setattr(sinks, name, 0.5)
    said: list[str] = []
    with open_sinks(save=tmp_path / "out.rrd", connect=stranger, on_message=said.append) as sink:
        for k in range(5):
            send(sink, 50 * k)
            sink.check()
    assert said  # that it went away, stopped answering, or did not take everything
    assert all(message.startswith(f"the viewer at {stranger} ") for message in said)
    file = read_back(tmp_path / "out.rrd")
    assert "1 file verified" in file.verify()
    assert len(file.temporal("points")) == 250


def saved(path: Path) -> Path:
    with open_sinks(save=path) as sink:
        send(sink, 0)
    return path


def test_a_recording_of_another_version_is_read_as_rerun_reads_it(tmp_path: Path) -> None:
    """Behind the magic stand the version's bytes; what is in it has no timeline ``time`` here."""
    path = saved(tmp_path / "out.rrd")
    content = bytearray(path.read_bytes())
    content[4:8] = b"\x00\x63\x00\x00"  # 0.99.0
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"out\.rrd: has no scans on a timeline 'step'"):
        Clock.read(path)


@pytest.mark.parametrize("damage", ["cut", "old magic", "garbage"])
@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_damaged_recording_is_refused(tmp_path: Path, damage: str) -> None:
    path = saved(tmp_path / "out.rrd")
    content = path.read_bytes()
    changed = {"cut": content[: len(content) // 2], "old magic": b"RRF0" + content[4:], "garbage": b"RRF2" + bytes(999)}
    path.write_bytes(changed[damage])
    with pytest.raises(InputError, match=r"out\.rrd: "):
        Clock.read(path)
