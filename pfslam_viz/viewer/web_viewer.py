"""Rerun's web viewer for a browser on this machine.

``rerun.serve_web_viewer`` listens on every interface and cannot be told otherwise, so the viewer's own program serves
the page: it takes an address.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

from pfslam_viz.errors import PfslamError
from pfslam_viz.viewer.connections import answers, free_port, is_free, viewer_binary
from pfslam_viz.viewer.headless import running

HOST = "127.0.0.1"
PORT = 9090  # Rerun's own
START_SECONDS = 20.0


@contextmanager
def web_viewer(source: str, say: Callable[[str], None]) -> Iterator[str]:
    """Serve the page on the loopback until the block ends; its address, which ``say`` is told too.

    ``source`` is the URL of the server that the page takes its data from. Raises PfslamError where it does not start.
    """
    port = PORT if is_free(HOST, PORT) else free_port(HOST)
    command: list[str | Path] = [viewer_binary(), "--serve-web", "--bind", HOST, "--web-viewer-port", str(port), source]
    with tempfile.TemporaryDirectory() as folder, running(command, Path(folder) / "output") as process:
        deadline = time.monotonic() + START_SECONDS
        while not answers(HOST, port):
            if process.poll() is not None or time.monotonic() > deadline:
                raise PfslamError("the web viewer does not start; --serve alone serves the desktop's")
            time.sleep(0.05)
        address = f"http://{HOST}:{port}/?url={quote(source, safe='')}"
        say(f"the web viewer is at {address}")
        yield address
