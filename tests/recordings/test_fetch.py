"""Downloads from a server on this machine that serves good files, bad ones, and none."""

import hashlib
import http.server
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.recordings import download as downloading
from pfslam_viz.recordings import fetch as fetching
from pfslam_viz.recordings.download import Meter, Patience, Request, Unavailable, download, has_digest
from pfslam_viz.recordings.fetch import check_color, check_disparity, fetch
from pfslam_viz.recordings.sources import SOURCES, RemoteFile, Source

QUICK = Patience(timeout=0.4, tries=3, pause=0.01)
GOOD = bytes(range(256)) * 1000


class Server:
    """What is served by path: bytes, or a function that answers a request itself."""

    def __init__(self) -> None:
        self.answers: dict[str, bytes | Callable[[http.server.BaseHTTPRequestHandler], None]] = {}
        self.asked: Counter[str] = Counter()
        self.at_once = self.most_at_once = 0
        outer, lock = self, threading.Lock()

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                with lock:
                    outer.asked[self.path] += 1
                    outer.at_once += 1
                    outer.most_at_once = max(outer.most_at_once, outer.at_once)
                answer = outer.answers.get(self.path)
                try:
                    if answer is None:
                        self.send_error(404)
                    elif callable(answer):
                        answer(self)
                    else:
                        send(self, answer)
                finally:
                    with lock:
                        outer.at_once -= 1

            def log_message(self, *args: object) -> None:
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


def send(handler: http.server.BaseHTTPRequestHandler, body: bytes, length: int | None = None) -> None:
    handler.send_response(200)
    handler.send_header("Content-Length", str(len(body) if length is None else length))
    handler.end_headers()
    handler.wfile.write(body)


def short(handler: http.server.BaseHTTPRequestHandler) -> None:
    send(handler, GOOD[:1000], len(GOOD))
    handler.close_connection = True


def stall(handler: http.server.BaseHTTPRequestHandler) -> None:
    send(handler, GOOD[:1000], len(GOOD))
    time.sleep(1.5)
    handler.close_connection = True


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.close()


def blob_id(content: bytes) -> str:
    return "git:" + hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()


def good(path: Path) -> str | None:
    return None if path.read_bytes() == GOOD else "wrong bytes"


def get(server: Server, path: str, target: Path) -> None:
    download(Request([f"{server.url}{path}"], target, good), patience=QUICK)


def test_digests(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"hello\n")
    # What `git hash-object` and `sha256sum` say of a file with the line "hello".
    assert has_digest(path, "git:ce013625030ba8dba906f756967f9e9ca394464a")
    assert has_digest(path, "sha256:5891b5b522d5df086d0ff0b110fbd9d21bb4fc7163af34d08286a2e846f6be03")
    assert not has_digest(path, "git:ce013625030ba8dba906f756967f9e9ca394464b")


def test_good_file(server: Server, tmp_path: Path) -> None:
    server.answers["/x"] = GOOD
    heard: list[tuple[int, int]] = []
    request = Request([f"{server.url}/x"], tmp_path / "new" / "x", good, lambda *at: heard.append(at))
    download(request, patience=QUICK)
    assert (tmp_path / "new" / "x").read_bytes() == GOOD
    assert heard[-1] == (len(GOOD), len(GOOD))


@pytest.mark.parametrize(
    ("answer", "message", "tries"),
    [
        (b"wrong", "wrong bytes", 1),
        (None, r"not there \(404\)", 1),
        (short, "3 times", 3),
        (stall, r"no data for 0\.4 s, 3 times", 3),
        (lambda handler: handler.send_error(500), "the server answered 500 .*, 3 times", 3),
        (lambda handler: handler.send_error(403), "the server answered 403", 1),
    ],
)
def test_failures_leave_nothing(
    server: Server,
    tmp_path: Path,
    answer: bytes | Callable[[http.server.BaseHTTPRequestHandler], None] | None,
    message: str,
    tries: int,
) -> None:
    if answer is not None:
        server.answers["/x"] = answer
    with pytest.raises(Unavailable, match=message) as caught:
        get(server, "/x", tmp_path / "x")
    assert f"{server.url}/x" in str(caught.value) and "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
    assert server.asked["/x"] == tries


@pytest.mark.parametrize("first", [short, stall, lambda handler: handler.send_error(500)])
def test_second_try_succeeds(
    server: Server, tmp_path: Path, first: Callable[[http.server.BaseHTTPRequestHandler], None]
) -> None:
    server.answers["/x"] = lambda handler: first(handler) if server.asked["/x"] == 1 else send(handler, GOOD)
    get(server, "/x", tmp_path / "x")
    assert (tmp_path / "x").read_bytes() == GOOD
    assert server.asked["/x"] == 2


def test_redirect(server: Server, tmp_path: Path) -> None:
    for path, target in (("/x", "/there"), ("/loop", "/loop")):
        server.answers[path] = lambda handler, target=target: redirect_to(handler, target)  # type: ignore[misc]
    server.answers["/there"] = GOOD
    get(server, "/x", tmp_path / "x")
    assert (tmp_path / "x").read_bytes() == GOOD
    with pytest.raises(Unavailable, match="redirected without end"):
        get(server, "/loop", tmp_path / "y")


def redirect_to(handler: http.server.BaseHTTPRequestHandler, path: str) -> None:
    handler.send_response(302)
    handler.send_header("Location", path)
    handler.send_header("Content-Length", "0")
    handler.end_headers()


def test_short_body_that_nobody_else_notices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Older versions of requests take a body for whole when the server hangs up."""
    import pooch

    class Downloader:
        def __init__(self, progressbar: Meter, **options: object) -> None:
            self.meter = progressbar

        def __call__(self, url: str, path: str, unused: None) -> None:
            self.meter.total = 10
            Path(path).write_bytes(b"12345")

    monkeypatch.setattr(pooch, "HTTPDownloader", Downloader)
    with pytest.raises(Unavailable, match="only 5 of 10 bytes came, 3 times"):
        download(Request(["http://127.0.0.1/x"], tmp_path / "x", lambda path: None), patience=QUICK)
    assert list(tmp_path.iterdir()) == []


def test_no_server(tmp_path: Path) -> None:
    server = Server()
    server.close()
    with pytest.raises(Unavailable, match="no connection"):
        get(server, "/x", tmp_path / "x")


def test_folder_that_cannot_be_written(server: Server, tmp_path: Path) -> None:
    server.answers["/x"] = GOOD
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        get(server, "/x", tmp_path / "file" / "x")


# --- whole recordings ---


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, bytes]:
    """Set 21 with short files, four colour and five disparity images; a small log. Returns the files by path."""
    kinect = tmp_path / "kinect.npz"
    # The disparity images nearest in time to colour 1 and 3 are 1 and 4.
    np.savez(kinect, rgb_time_stamps=[0.0, 1.0, 2.0, 3.0], disparity_time_stamps=[0.1, 0.9, 1.4, 2.1, 3.2])
    contents = {"Encoders21.npz": b"e" * 100, "Hokuyo21.npz": GOOD, "Imu21.npz": b"i" * 100}
    contents["Kinect21.npz"] = kinect.read_bytes()
    kinect.unlink()
    files = tuple(RemoteFile(name, f"o/r/c/{name}", blob_id(content)) for name, content in contents.items())
    monkeypatch.setitem(SOURCES, "21", Source("21", "ece276a", "", "", "1 kB", files, (4, 5), "no licence"))
    log = b"FLASER 1 1.00 0 0 0 0 0 0 1.0 host 0\n"
    file = RemoteFile("intel.clf", "o/r/c/intel_original.clf", "sha256:" + hashlib.sha256(log).hexdigest())
    monkeypatch.setitem(SOURCES, "intel", Source("intel", "carmen", "", "", "1 kB", (file,), notice="CC BY"))
    served = {f"/o/r/c/{name}": content for name, content in contents.items()}
    color = png(np.full((480, 640, 3), 7, dtype=np.uint8))
    disparity = png(np.full((480, 640), 700, dtype=np.uint16))
    source = SOURCES["21"]
    served |= {f"/{source.color_frame(k).path}": color for k in range(1, 5)}
    served |= {f"/{source.disparity_frame(k).path}": disparity for k in range(1, 6)}
    return served | {"/o/r/c/intel_original.clf": log}


def png(image: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", image)[1])


def run(server: Server, data: Path, name: str = "21", **options: object) -> list[Path]:
    return fetch(name, data, base_url=server.url, progress=False, patience=QUICK, **options)  # type: ignore[arg-type]


def test_a_set(server: Server, small: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    server.answers |= small
    paths = run(server, tmp_path)
    assert [path.name for path in paths] == ["Encoders21.npz", "Hokuyo21.npz", "Imu21.npz", "Kinect21.npz"]
    assert all(path.parent == tmp_path / "21" for path in paths)
    assert paths[1].read_bytes() == GOOD
    assert (tmp_path / "21" / "SOURCE-21.txt").read_text() == "no licence"
    assert capsys.readouterr().err.count("no licence") == 1
    asked = server.asked.total()
    assert run(server, tmp_path) == paths
    assert server.asked.total() == asked
    assert "no licence" not in capsys.readouterr().err


def test_what_is_missing_is_resumed(server: Server, small: dict[str, bytes], tmp_path: Path) -> None:
    server.answers |= small
    del server.answers["/o/r/c/Hokuyo21.npz"]
    with pytest.raises(PfslamError, match=r"Hokuyo21\.npz: not there \(404\).*run the same command again") as caught:
        run(server, tmp_path)
    assert caught.value.exit_status == 1
    assert sorted(path.name for path in (tmp_path / "21").iterdir()) == ["Encoders21.npz", "Imu21.npz", "Kinect21.npz"]
    server.answers |= small
    assert len(run(server, tmp_path)) == 4
    assert server.asked["/o/r/c/Imu21.npz"] == 1


def test_where_nothing_comes_no_folder_is_left(server: Server, tmp_path: Path) -> None:
    server.answers.clear()
    with pytest.raises(PfslamError, match="404"):
        run(server, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_wrong_content_is_not_kept(server: Server, small: dict[str, bytes], tmp_path: Path) -> None:
    server.answers |= small | {"/o/r/c/Imu21.npz": b"j" * 100}
    with pytest.raises(PfslamError, match=r"Imu21\.npz: its content is not what was published"):
        run(server, tmp_path)
    assert not (tmp_path / "21" / "Imu21.npz").exists()


def test_other_content_in_its_place_is_kept_aside(server: Server, small: dict[str, bytes], tmp_path: Path) -> None:
    server.answers |= small
    (tmp_path / "Imu21.npz").write_bytes(b"my own")
    paths = run(server, tmp_path)
    assert paths[2] == tmp_path / "Imu21.npz"  # where the set's files already lie
    assert paths[2].read_bytes() == b"i" * 100
    assert (tmp_path / "Imu21.npz.old").read_bytes() == b"my own"


def test_a_mirror_with_the_files_own_names(server: Server, small: dict[str, bytes], tmp_path: Path) -> None:
    server.answers |= {f"/sub/{Path(path).name}": content for path, content in small.items() if path.endswith("npz")}
    assert len(fetch("21", tmp_path, base_url=f"{server.url}/sub/", progress=False, patience=QUICK)) == 4


def test_a_log(server: Server, small: dict[str, bytes], tmp_path: Path) -> None:
    from pfslam_viz.recordings.catalog import load_recording

    server.answers |= small
    assert run(server, tmp_path, "intel") == [tmp_path / "intel" / "intel.clf"]
    assert load_recording("intel", tmp_path).name == "intel"
    other = tmp_path / "other"
    other.mkdir()
    (other / "intel_original.clf").write_bytes(small["/o/r/c/intel_original.clf"])
    assert run(server, other, "intel") == [other / "intel_original.clf"]


def test_frames(server: Server, small: dict[str, bytes], tmp_path: Path) -> None:
    server.answers |= small
    paths = run(server, tmp_path, rgbd=True, connections=2)
    images = [path.relative_to(tmp_path / "21/dataRGBD").as_posix() for path in paths[4:]]
    assert images == [f"RGB21/rgb21_{k}.png" for k in range(1, 5)] + [
        f"Disparity21/disparity21_{k}.png" for k in range(1, 6)
    ]
    last = cv2.imread(str(paths[-1]), cv2.IMREAD_UNCHANGED)
    assert last is not None and last[0, 0] == 700
    assert server.most_at_once <= 2
    asked = server.asked.total()
    paths[-1].unlink()
    run(server, tmp_path, rgbd=True)
    assert server.asked.total() == asked + 1


def test_every_second_frame_with_the_disparity_nearest_in_time(
    server: Server, small: dict[str, bytes], tmp_path: Path
) -> None:
    server.answers |= small
    images = [path.name for path in run(server, tmp_path, rgbd=True, every=2)[4:]]
    assert images == ["rgb21_1.png", "rgb21_3.png", "disparity21_1.png", "disparity21_4.png"]


def test_bad_frames_are_not_kept(server: Server, small: dict[str, bytes], tmp_path: Path) -> None:
    source = SOURCES["21"]
    half = small[f"/{source.color_frame(1).path}"][:-100]
    server.answers |= small | {f"/{source.color_frame(2).path}": half}
    del server.answers[f"/{source.disparity_frame(3).path}"]
    with pytest.raises(PfslamError, match=r"2 of 9 frames could not be fetched .*the others are kept"):
        run(server, tmp_path, rgbd=True)
    assert len(list((tmp_path / "21" / "dataRGBD").rglob("*.png"))) == 7
    assert len([path for path in (tmp_path / "21").rglob("*") if path.is_file()]) == 4 + 7 + 1


def test_frames_that_all_fail_end_it(
    server: Server, small: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fetching, "_HOPELESS", 3)
    server.answers |= {path: content for path, content in small.items() if path.endswith(".npz")}
    with pytest.raises(PfslamError, match="the first 3 frames all failed"):
        run(server, tmp_path, rgbd=True, connections=1)


@pytest.mark.parametrize(
    ("image", "color", "disparity"),
    [
        (np.zeros((480, 640, 3), np.uint8), None, "480 x 640 x 3 uint8"),
        (np.zeros((480, 640), np.uint16), "480 x 640 uint16", None),
        (np.zeros((480, 640), np.uint8), "480 x 640 uint8", "480 x 640 uint8"),
        (np.zeros((240, 320, 3), np.uint8), "240 x 320 x 3", "240 x 320 x 3"),
    ],
)
def test_checks_of_frames(tmp_path: Path, image: np.ndarray, color: str | None, disparity: str | None) -> None:
    path = tmp_path / "x.png"
    path.write_bytes(png(image))
    for check, wrong in ((check_color, color), (check_disparity, disparity)):
        answer = check(path)
        assert answer is None if wrong is None else answer is not None and wrong in answer
    path.write_bytes(png(image)[:-20])
    assert check_color(path) == "not a whole PNG image"


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("nonsense", {}, "is not a recording that can be fetched; there are 20, 21, 23, intel"),
        ("demo", {}, "made on first use"),
        ("23", {"rgbd": True}, "has no colour and disparity images"),
        ("21", {"every": 0}, "--every"),
        ("21", {"connections": 0}, "--connections"),
        ("21", {"base_url": "ftp://x"}, "must start with http"),
    ],
)
def test_wrong_use(tmp_path: Path, name: str, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fetch(name, tmp_path, progress=False, **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_every_public_file_is_pinned() -> None:
    for source in SOURCES.values():
        assert bool(source.files) == bool(source.notice)
        for file in source.files:
            assert file.digest is not None
            kind, _, value = file.digest.partition(":")
            assert (kind, len(value)) in (("git", 40), ("sha256", 64))
            owner, repository, commit, *rest = file.path.split("/")
            assert owner and repository and len(commit) == 40 and rest


def test_pinned_hashes_fit_the_real_files(shared_data: Path) -> None:
    checked = 0
    for source in SOURCES.values():
        for file in source.files:
            path = shared_data / source.format / file.name
            if path.exists():
                assert file.digest is not None and has_digest(path, file.digest), path
                checked += 1
    assert checked == 12


def test_a_redirect_to_another_host_is_not_followed(server: Server, tmp_path: Path) -> None:
    """The other host is this machine by another name, so that a request would be seen."""
    other = server.url.replace("127.0.0.1", "localhost")
    server.answers["/y"] = GOOD
    for path, to in (("/x", f"{other}/y"), ("/z", "//localhost/y")):
        server.answers[path] = lambda handler, to=to: redirect_to(handler, to)  # type: ignore[misc]
    for path in ("/x", "/z"):
        with pytest.raises(Unavailable, match="redirected to another host, localhost, which is not followed"):
            get(server, path, tmp_path / "x")
    assert (server.asked["/x"], server.asked["/y"]) == (1, 0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("here", "there", "followed"),
    [
        ("https://a.org/x", "http://a.org/x", False),
        ("https://a.org/x", "https://a.org/y", True),
        ("http://a.org/x", "https://a.org/x", True),
        ("https://a.org/x", "ftp://a.org/x", False),
        ("https://a.org/x", "https://a.org.evil.com/x", False),
        ("https://a.org/x", "https://a.org@evil.com/x", False),
        ("https://a.org/x", "/y", True),
    ],
)
def test_which_redirects_are_followed(here: str, there: str, followed: bool) -> None:
    response = SimpleNamespace(is_redirect=True, url=here, headers={"location": there})
    if followed:
        downloading._refuse_redirect(response)
    else:
        with pytest.raises(downloading._Failed, match="not followed"):
            downloading._refuse_redirect(response)


def test_a_body_without_an_end_is_not_taken(server: Server, tmp_path: Path) -> None:
    def endless(handler: http.server.BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.end_headers()
        handler.close_connection = True
        with suppress(OSError):
            while True:
                handler.wfile.write(GOOD)

    server.answers["/x"] = endless
    with pytest.raises(Unavailable, match="more than 4 MB come"):
        download(Request([f"{server.url}/x"], tmp_path / "x", good, most=4 << 20), patience=QUICK)
    assert list(tmp_path.iterdir()) == []
