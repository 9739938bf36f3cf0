"""Rerun's own viewer without a screen, driven and measured from here."""

import os
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pfslam_viz.viewer.sinks import viewer_binary

START_SECONDS = 30.0


@dataclass
class HeadlessViewer:
    """A running viewer and the connection that drives it."""

    client: Any
    process: "subprocess.Popen[bytes]"

    def open(self, path: Path) -> float:
        """Open a recording; seconds until it is loaded and painted."""
        start = time.perf_counter()
        self.client.open(str(path.resolve()))
        self.client.take_screenshot(max_size=64)
        return time.perf_counter() - start

    def seek(self, step: int) -> float:
        """Move to a step; seconds until it is painted."""
        start = time.perf_counter()
        self.client.set_time("step", sequence=step, play_state="paused")
        self.client.take_screenshot(max_size=64)
        return time.perf_counter() - start

    def reports(self) -> list[str]:
        """What the views complain of."""
        return [str(report) for view in self.client.get_state().views for report in view.reports]

    def memory_mb(self) -> dict[str, float]:
        """Resident memory now and at its peak (Linux)."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        values = {line.split(":")[0]: line.split()[1] for line in status.splitlines() if line.startswith("Vm")}
        return {"now": int(values["VmRSS"]) * 1024 / 1e6, "peak": int(values["VmHWM"]) * 1024 / 1e6}


@contextmanager
def headless_viewer(size: str = "1600x900", port: int = 9917) -> Iterator[HeadlessViewer]:
    """Start a viewer on the loopback and end it with the block. Needs Vulkan, Mesa's software one will do."""
    from rerun.experimental import ViewerClient

    command = [str(viewer_binary()), "--headless", "--hide-welcome-screen", "--memory-limit", "4GB"]
    command += ["--bind", "127.0.0.1", "--port", str(port), "--window-size", size]
    with tempfile.TemporaryDirectory() as runtime:
        process = subprocess.Popen(
            command,
            env=dict(os.environ, XDG_RUNTIME_DIR=runtime),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            deadline = time.monotonic() + START_SECONDS
            while True:
                try:
                    client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
                    client.get_state()
                    break
                except Exception:
                    if process.poll() is not None or time.monotonic() > deadline:
                        raise
                    time.sleep(0.1)
            yield HeadlessViewer(client, process)
        finally:
            process.terminate()
            process.wait(10)
