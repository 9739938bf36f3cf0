"""Viewers and ports on this machine and elsewhere: start a viewer, serve one, see whether one answers."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import rerun as rr

from pfslam_viz.errors import InputError, PfslamError

PORT = 9876  # Rerun's own
LOOPBACK = ("127.0.0.1", "::1", "localhost")
START_SECONDS = 20.0  # a viewer has this long to open its port


def serve_at(address: str, say: Callable[[str], None]) -> tuple[rr.GrpcServerSink, str]:
    """A server for viewers on ``address``, and the URL to watch it at, which ``say`` is told too."""
    port = PORT if is_free(address, PORT) else free_port(address)
    server = rr.GrpcServerSink(bind_ip=address, port=port)
    if address not in LOOPBACK:
        say(f"warning: serving on {address}: everybody who can reach this machine's port {port} can watch")
    host = "127.0.0.1" if address in ("0.0.0.0", "::", *LOOPBACK) else address
    url = f"rerun+http://{host}:{port}/proxy"
    say(f"serving at {url}; watch with: rerun {url}")
    return server, url


def viewer_binary() -> Path:
    """The viewer that comes with rerun-sdk."""
    import rerun_cli

    folder = Path(rerun_cli.__file__).parent
    return folder / ("rerun.exe" if sys.platform == "win32" else "rerun")


def out_of_reach_of_ctrl_c() -> dict[str, Any]:
    """What starts a process that the terminal's Ctrl-C does not reach: a session, on Windows a group, of its own."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"start_new_session": True}


def spawn_viewer() -> str:
    """Start a viewer that listens on the loopback only; its URL. It outlives this process and its Ctrl-C."""
    port = PORT if is_free("127.0.0.1", PORT) else free_port("127.0.0.1")
    command = [str(viewer_binary()), "--bind", "127.0.0.1", "--port", str(port), "--expect-data-soon"]
    try:
        viewer = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "RERUN_APP_ONLY": "true"},
            **out_of_reach_of_ctrl_c(),
        )
    except OSError as error:
        raise PfslamError(f"the viewer cannot be started: {command[0]}: {error.strerror}") from None
    deadline = time.monotonic() + START_SECONDS
    while not answers("127.0.0.1", port):
        if viewer.poll() is not None:
            raise PfslamError(
                f"the viewer ended with status {viewer.returncode} as it started: is there a screen and a graphics"
                " driver? Write a file with --save instead"
            )
        if time.monotonic() > deadline:
            raise PfslamError(f"the viewer did not start within {START_SECONDS:.0f} s")
        time.sleep(0.05)
    return f"rerun+http://127.0.0.1:{port}/proxy"


def check_answers(url: str) -> None:
    """Raise InputError where ``url`` is not a viewer's, or nobody answers there."""
    parts = urlsplit(url)
    try:
        port, readable = parts.port, True
    except ValueError:
        port, readable = None, False
    schemes = ("rerun", "rerun+http", "rerun+https")
    if not readable or parts.scheme not in schemes or not parts.hostname or parts.path != "/proxy":
        raise InputError(f"--connect {url}: write it as rerun+http://HOST:{PORT}/proxy")
    port = port or {"rerun+http": 80, "rerun+https": 443}.get(parts.scheme, PORT)
    if not answers(parts.hostname, port, seconds=3.0):
        raise InputError(f"--connect {url}: nobody answers there; start a viewer first: rerun --bind 127.0.0.1")


def answers(host: str, port: int, seconds: float = 0.5) -> bool:
    """Whether somebody listens on the port."""
    try:
        with socket.create_connection((host, port), timeout=seconds):
            return True
    except OSError:
        return False


def is_free(host: str, port: int) -> bool:
    """Whether nobody listens on this machine's port."""
    try:
        _bind(host, port)
        return True
    except OSError:
        return False


def free_port(host: str) -> int:
    """A port on ``host`` that nobody listens on. Raises InputError when the address is not this machine's."""
    try:
        return _bind(host, 0)
    except OSError as error:
        raise InputError(f"cannot listen on {host}: {error.strerror or error}") from None


def _bind(host: str, port: int) -> int:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        if sys.platform != "win32":
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
        return int(probe.getsockname()[1])
