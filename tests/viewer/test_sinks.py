"""Destinations come and go; the file is what must be right."""

import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rerun as rr

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.viewer import connections, sinks
from pfslam_viz.viewer.connections import viewer_binary
from pfslam_viz.viewer.sinks import Sink, open_sinks

if TYPE_CHECKING:
    from tests.viewer.conftest import Readable


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def send(sink: Sink, first: int, count: int = 50, points: int = 20) -> None:
    steps = np.arange(first, first + count)
    times = [rr.TimeColumn("step", sequence=steps)]
    positions = np.random.default_rng(first).random((count * points, 3))
    sink.send_columns("points", times, rr.Points3D.columns(positions=positions).partition([points] * count))


@pytest.fixture
def proxy() -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A process that takes what is streamed to it, as a viewer does: (process, url)."""
    port = free_port()
    command = [str(viewer_binary()), "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 20
    while not connections.answers("127.0.0.1", port):
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.05)
    yield process, f"rerun+http://127.0.0.1:{port}/proxy"
    process.kill()
    process.wait()


def test_a_file_is_moved_into_place_when_it_is_complete(tmp_path: Path, read_back: "type[Readable]") -> None:
    path = tmp_path / "new" / "out.rrd"
    with open_sinks(save=path, name="a name") as sink:
        send(sink, 0)
        assert not path.exists()
        assert rr.get_application_id(sink.recording) == "pfslam-viz"
    assert sink.size == path.stat().st_size > 1000
    file = read_back(path)
    assert "1 file verified" in file.verify()
    assert len(file.temporal("points")) == 50
    assert list(path.parent.iterdir()) == [path]  # and nothing beside it


def test_an_interrupted_run_keeps_what_was_logged(tmp_path: Path, read_back: "type[Readable]") -> None:
    path = tmp_path / "out.rrd"
    with pytest.raises(KeyboardInterrupt), open_sinks(save=path) as sink:
        sink.before_close(lambda: send(sink, 50))  # what had been gathered but not sent
        send(sink, 0)
        raise KeyboardInterrupt
    file = read_back(path)
    assert "1 file verified" in file.verify()
    assert len(file.temporal("points")) == 100


def test_a_failed_run_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "out.rrd"
    path.write_bytes(b"RRF2 pfslam-viz, old")
    with pytest.raises(ValueError, match="bug"), open_sinks(save=path) as sink:
        send(sink, 0)
        raise ValueError("bug")
    assert path.read_bytes() == b"RRF2 pfslam-viz, old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"), open_sinks(save=tmp_path / "file" / "out.rrd"):
        pass


def test_nowhere_to_send_it_to() -> None:
    with pytest.raises(InputError, match="--save"), open_sinks():
        pass


@pytest.mark.parametrize(
    "url", ["127.0.0.1:9876", "http://127.0.0.1:9876/proxy", "rerun+http://127.0.0.1:9876", "rerun+http://h:x/proxy"]
)
def test_a_wrong_url_says_how_to_write_it(url: str) -> None:
    with pytest.raises(InputError, match=r"rerun\+http://HOST:9876/proxy"), open_sinks(connect=url):
        pass


def test_a_url_where_nobody_answers(tmp_path: Path) -> None:
    url = f"rerun+http://127.0.0.1:{free_port()}/proxy"
    with pytest.raises(InputError, match="nobody answers"), open_sinks(save=tmp_path / "x.rrd", connect=url):
        pass
    assert not list(tmp_path.iterdir())


def test_what_was_pushed_gets_there_without_being_waited_for(tmp_path: Path) -> None:
    """The batcher alone would keep it for half a minute."""
    with open_sinks(save=tmp_path / "out.rrd") as sink:
        sink.check()
        before = sink.size
        sink.log_static("x", rr.Points3D([[0, 0, 0]]))
        sink.push()
        deadline = time.monotonic() + 10
        while sink.size == before and time.monotonic() < deadline:
            time.sleep(0.01)
        assert (sink.size or 0) > (before or 0)


def test_a_viewer_and_a_file_get_the_same(
    proxy: tuple[subprocess.Popen[bytes], str], tmp_path: Path, read_back: "type[Readable]"
) -> None:
    _, url = proxy
    with open_sinks(save=tmp_path / "out.rrd", connect=url) as sink:
        assert sink.live
        send(sink, 0)
        sink.check()
    assert sink.messages == []
    received = tmp_path / "received.rrd"
    command = [str(viewer_binary()), "--connect", url, "--save", str(received)]
    command += ["--port", str(free_port()), "--bind", "127.0.0.1"]
    reader = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        rows: list[Any] = []
        deadline = time.monotonic() + 10
        while len(rows) < 50 and time.monotonic() < deadline:
            time.sleep(0.2)
            if received.is_file() and received.stat().st_size > 5000:
                rows = read_back(received).temporal("points")
    finally:
        reader.kill()
        reader.wait()
    assert [row["step"] for row in rows] == list(range(50))


def test_a_viewer_that_goes_away_costs_the_picture_and_not_the_file(
    proxy: tuple[subprocess.Popen[bytes], str], tmp_path: Path, read_back: "type[Readable]"
) -> None:
    process, url = proxy
    with open_sinks(save=tmp_path / "out.rrd", connect=url) as sink:
        send(sink, 0)
        sink.check()
        process.kill()
        process.wait()
        for block in range(1, 5):
            send(sink, 50 * block)
            sink.check()
            time.sleep(0.05)
        send(sink, 250)
    (message,) = sink.messages
    assert "went away in mid-run" in message and "out.rrd is still being written" in message
    file = read_back(tmp_path / "out.rrd")
    assert "1 file verified" in file.verify()
    assert len(file.temporal("points")) == 300


def test_a_viewer_that_hangs_costs_no_more_than_its_patience(
    proxy: tuple[subprocess.Popen[bytes], str],
    tmp_path: Path,
    read_back: "type[Readable]",
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    process, url = proxy
    monkeypatch.setattr(sinks, "FLUSH_SECONDS", 0.1)
    with open_sinks(save=tmp_path / "out.rrd", connect=url) as sink:
        send(sink, 0)
        sink.check()
        process.send_signal(signal.SIGSTOP)
        for block in range(1, 40):
            send(sink, 50 * block, points=2000)
            sink.check()
            if sink.messages:
                break
    process.kill()  # lets go of the stream that was left behind
    process.wait()
    assert "stopped answering" in sink.messages[0]
    assert "1 file verified" in read_back(tmp_path / "out.rrd").verify()


def test_without_a_file_the_run_goes_on_into_nothing(proxy: tuple[subprocess.Popen[bytes], str]) -> None:
    process, url = proxy
    with open_sinks(connect=url) as sink:
        process.kill()
        process.wait()
        deadline = time.monotonic() + 10
        while not sink.messages and time.monotonic() < deadline:
            send(sink, 0)
            sink.check()
            time.sleep(0.05)
        send(sink, 50)
        sink.log_static("x", rr.Points3D([[0, 0, 0]]))
        assert sink.size is None
    assert "went away" in sink.messages[0]


def test_serving_is_on_the_loopback_and_lasts_until_it_is_told(tmp_path: Path) -> None:
    held: list[bool] = []
    said: list[str] = []
    with open_sinks(
        save=tmp_path / "out.rrd", serve=True, hold=lambda: held.append(True), on_message=said.append
    ) as sink:
        send(sink, 0)
        url = sink.messages[0].split()[-1]
        port = int(url.split(":")[2].split("/")[0])
        sockets = Path("/proc/net/tcp")
        lines = [line.split() for line in sockets.read_text().splitlines()[1:]] if sockets.is_file() else []
        listening = {line[1] for line in lines if line[3] == "0A"}
        assert connections.answers("127.0.0.1", port)
        if listening:  # address and port in hexadecimal, where the system tells
            assert f"0100007F:{port:04X}" in listening and f"00000000:{port:04X}" not in listening
    assert held == [True]
    assert said == sink.messages and "until Ctrl-C" in said[-1]
    assert (tmp_path / "out.rrd").is_file()


def test_serving_elsewhere_warns() -> None:
    with open_sinks(serve="127.0.0.2", hold=lambda: None, on_message=lambda message: None) as sink:
        assert sink.messages[0].startswith("warning: serving on 127.0.0.2")


def test_an_address_that_is_not_ours() -> None:
    with pytest.raises(InputError, match=r"192\.0\.2\.1"), open_sinks(serve=True, bind="192.0.2.1"):
        pass


def test_a_viewer_that_cannot_start_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dud = tmp_path / "rerun"
    dud.write_text("#!/bin/sh\nexit 7\n")
    dud.chmod(0o755)
    monkeypatch.setattr(connections, "viewer_binary", lambda: dud)
    with pytest.raises(PfslamError, match="status 7"), open_sinks(spawn=True):
        pass
    monkeypatch.setattr(connections, "viewer_binary", lambda: tmp_path / "absent")
    with pytest.raises(PfslamError, match="cannot be started"), open_sinks(spawn=True):
        pass


def test_standard_output_holds_the_recording_and_nothing_else(tmp_path: Path, read_back: "type[Readable]") -> None:
    script = """
        import rerun as rr
        from pfslam_viz.viewer.sinks import open_sinks
        with open_sinks(stdout=True) as sink:
            times = [rr.TimeColumn("step", sequence=[3]), rr.TimeColumn("time", duration=[0.5])]
            sink.send_columns("points", times, rr.Points3D.columns(positions=[[1, 2, 3]]))
    """
    with (tmp_path / "out.rrd").open("wb") as out:
        subprocess.run([sys.executable, "-c", textwrap.dedent(script)], stdout=out, check=True)
    (row,) = read_back(tmp_path / "out.rrd").temporal("points")
    assert row["step"] == 3 and row["time"].total_seconds() == 0.5


SEND = """
    import resource, sys
    from pathlib import Path
    import numpy as np, rerun as rr
    from pfslam_viz.errors import PfslamError
    from pfslam_viz.viewer import sinks
    from pfslam_viz.viewer.sinks import open_sinks

    sinks.WRITE_SECONDS = 2.0

    def send(sink, blocks):
        for k in range(blocks):
            positions = np.random.default_rng(k).random((100_000, 3))
            times = [rr.TimeColumn("step", sequence=range(10 * k, 10 * k + 10))]
            sink.send_columns("points", times, rr.Points3D.columns(positions=positions).partition([10_000] * 10))
            sink.check()
"""


def test_a_full_disk_ends_the_run_and_leaves_nothing(tmp_path: Path) -> None:
    script = (
        SEND
        + """
    resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, 2_000_000))
    try:
        with open_sinks(save=Path(sys.argv[1])) as sink:
            send(sink, 10)
    except PfslamError as error:
        print(error)
    """
    )
    command = [sys.executable, "-c", textwrap.dedent(script), str(tmp_path / "out.rrd")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "out.rrd: cannot be written (is the disk full?)" in done.stdout
    assert not list(tmp_path.iterdir())


def test_a_reader_of_standard_output_that_goes_away_costs_only_itself(
    tmp_path: Path, read_back: "type[Readable]"
) -> None:
    script = (
        SEND
        + """
    with open_sinks(stdout=True, save=Path(sys.argv[1])) as sink:
        send(sink, 10)
    """
    )
    command = [sys.executable, "-c", textwrap.dedent(script), str(tmp_path / "out.rrd")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.read(1000)
        process.stdout.close()
        errors = process.stderr.read().decode()
        assert process.wait() == 0, errors
    assert "standard output went away in mid-run" in errors and "Traceback" not in errors
    assert len(read_back(tmp_path / "out.rrd").temporal("points")) == 100


@pytest.mark.slow
def test_a_spawned_viewer_shows_the_run_and_outlives_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from rerun.experimental import ViewerClient

    wrapper, number = tmp_path / "rerun", tmp_path / "pid"
    wrapper.write_text(f'#!/bin/sh\necho $$ > "{number}"\nexec "{viewer_binary()}" --headless "$@"\n')
    wrapper.chmod(0o755)
    monkeypatch.setattr(connections, "viewer_binary", lambda: wrapper)
    monkeypatch.setattr(connections, "PORT", free_port())
    try:
        with open_sinks(spawn=True, save=tmp_path / "out.rrd", name="a run") as sink:
            send(sink, 0)
            sink.check()
    except PfslamError as error:
        pytest.skip(f"no viewer can run here: {error}")
    try:
        client = ViewerClient.connect(f"rerun+http://127.0.0.1:{connections.PORT}/proxy")
        deadline = time.monotonic() + 20
        ends: list[int | None] = []
        while 49 not in ends and time.monotonic() < deadline:
            time.sleep(0.2)
            ends = [t.end for r in client.get_state().recordings for t in r.timelines if t.name == "step"]
        assert 49 in ends
    finally:
        os.kill(int(number.read_text()), signal.SIGKILL)
    assert sink.messages == []
    assert (tmp_path / "out.rrd").stat().st_size > 1000
