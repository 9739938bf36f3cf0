"""The web viewer's page, and the demo in it, in Chromium without a window, steered over WebDriver on the loopback.

The latter skips where there is no Chromium with its driver (Debian: chromium and chromium-driver).
"""

import base64
import json
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

import pytest

from pfslam_viz.viewer.connections import answers, free_port, viewer_binary
from pfslam_viz.viewer.headless import running
from pfslam_viz.viewer.web_viewer import web_viewer

HOST = "127.0.0.1"
PATIENCE = 120.0  # s; WebAssembly on a software renderer takes its time
CHROMIUM = (
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--window-size=1280,720",
    f"--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE {HOST}",  # nothing leaves this machine
)


class Browser:
    """As much of WebDriver as is needed: https://www.w3.org/TR/webdriver2."""

    def __init__(self, port: int, profile: Path) -> None:
        self._root = f"http://{HOST}:{port}"
        arguments = [*CHROMIUM, f"--user-data-dir={profile}"]
        wanted = {"capabilities": {"alwaysMatch": {"goog:chromeOptions": {"args": arguments}}}}
        self._root += f"/session/{self._ask('POST', '/session', wanted)['sessionId']}"

    def open(self, url: str) -> None:
        self._ask("POST", "/url", {"url": url})

    def photograph(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self._ask("GET", "/screenshot")))

    def close(self) -> None:
        self._ask("DELETE", "")

    def _ask(self, method: str, path: str, body: Any = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._root + path, data, {"Content-Type": "application/json"}, method=method)
        deadline = time.monotonic() + 20.0
        while True:
            try:
                with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                    return json.load(answer)["value"]
            except urllib.error.HTTPError:
                raise
            except urllib.error.URLError:  # the driver does not listen yet
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.1)


def listening_sockets() -> list[tuple[str, int]]:
    """Address, in hexadecimal, and port of every socket of this machine that listens; none where it does not tell."""
    tables = [path for path in (Path("/proc/net/tcp"), Path("/proc/net/tcp6")) if path.is_file()]
    rows = [line.split() for path in tables for line in path.read_text().splitlines()[1:]]
    return [(host, int(port, 16)) for row in rows if row[3] == "0A" for host, port in [row[1].split(":")]]


@pytest.fixture
def browser(tmp_path: Path) -> Iterator["Browser"]:
    driver = shutil.which("chromedriver")
    if driver is None or not (shutil.which("chromium") or shutil.which("google-chrome")):
        pytest.skip("no Chromium with its driver (Debian: chromium and chromium-driver)")
    port = free_port(HOST)
    with running([driver, f"--port={port}"], tmp_path / "driver.log"):
        opened = Browser(port, tmp_path / "profile")
        yield opened
        opened.close()


def test_the_page_is_served_on_the_loopback_alone() -> None:
    said: list[str] = []
    source = "rerun+http://127.0.0.1:9876/proxy"
    with web_viewer(source, said.append) as address:
        parts = urlsplit(address)
        assert (parts.scheme, parts.hostname, parse_qs(parts.query)) == ("http", "127.0.0.1", {"url": [source]})
        assert said == [f"the web viewer is at {address}"]
        with urllib.request.urlopen(address, timeout=20.0) as page:
            assert page.status == 200 and b"<html" in page.read()
        listening = {host for host, port in listening_sockets() if port == parts.port}
        assert listening in ({"0100007F"}, set())  # in hexadecimal, where the system tells
        assert listening or not listening_sockets()
    assert not answers("127.0.0.1", parts.port or 0)


@pytest.mark.slow
def test_the_demo_plays_in_the_web_viewer(
    browser: Browser, demo: Path, output: Path, shares: Callable[[Path], dict[str, float]], tmp_path: Path
) -> None:
    """The maps' background and both trajectories appear."""
    data, web = free_port(HOST), free_port(HOST)
    command = [str(viewer_binary()), "--serve-web", "--bind", HOST, "--port", str(data), "--web-viewer-port", str(web)]
    with running([*command, str(demo)], tmp_path / "server.log"):
        time.sleep(1.0)  # the page is served at once, the data when it is read
        source = quote(f"rerun+http://{HOST}:{data}/proxy", safe="")
        browser.open(f"http://{HOST}:{web}/?url={source}&renderer=webgl")
        picture, deadline = output / "demo_web.png", time.monotonic() + PATIENCE
        while True:
            browser.photograph(picture)
            found = shares(picture)
            if found["unknown"] > 0.3 and found["orange"] > 5e-5 and found["blue"] > 5e-4:
                break
            assert time.monotonic() < deadline, found
            time.sleep(1.0)
